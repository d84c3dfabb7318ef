#include "estimators/averaging/focal_averaging.h"

#include "colmap_ext/check.h"
#include "estimators/averaging/kruppa_cost.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <cmath>

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

namespace dgsfm {
namespace {

// Up to here the normal equations are cheaper dense than by conjugate
// gradients; sparse factors fill in: 13 times slower with 4000 cameras.
constexpr int kMaxNumDenseCameras = 50;

// Estimates that end within this of a bound count as outside [log ratio].
constexpr double kBoundMargin = 1e-6;

bool Solve(int max_num_iterations, ceres::Problem* problem) {
  ceres::Solver::Options options;
  options.minimizer_type = ceres::TRUST_REGION;
  options.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
  options.linear_solver_type =
      problem->NumParameterBlocks() <= kMaxNumDenseCameras
          ? ceres::DENSE_NORMAL_CHOLESKY
          : ceres::CGNR;
  options.jacobi_scaling = true;
  options.max_num_iterations = max_num_iterations;
  options.function_tolerance = 1e-10;
  options.gradient_tolerance = 1e-14;
  options.parameter_tolerance = 1e-10;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  options.minimizer_progress_to_stdout = false;
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem, &summary);
  return summary.IsSolutionUsable();
}

void CheckInput(const std::vector<PairFundamental>& pairs,
                const std::vector<char>& known,
                const std::vector<double>& focal_lengths_px) {
  DGSFM_CHECK(known.size() == focal_lengths_px.size());
  for (const double focal : focal_lengths_px) {
    DGSFM_CHECK(std::isfinite(focal) && focal > 0)
        << "focal length = " << focal;
  }
  const int num_cameras = static_cast<int>(known.size());
  for (const PairFundamental& pair : pairs) {
    for (const int camera : {pair.camera1, pair.camera2}) {
      DGSFM_CHECK(camera >= 0 && camera < num_cameras)
          << "camera " << camera << " of " << num_cameras;
    }
    DGSFM_CHECK(pair.F.allFinite() && !pair.F.isZero(0)) << "F = " << pair.F;
  }
}

}  // namespace

std::optional<AveragedFocal> AverageFocals(
    const std::vector<double>& focal_lengths_px) {
  if (focal_lengths_px.empty()) return std::nullopt;
  std::vector<double> logs;
  for (const double focal_length_px : focal_lengths_px) {
    DGSFM_CHECK(std::isfinite(focal_length_px) && focal_length_px > 0)
        << "focal length = " << focal_length_px;
    logs.push_back(std::log(focal_length_px));
  }
  const double median = Median(logs);
  return AveragedFocal{std::exp(median), RobustStddev(logs, median)};
}

bool ViewGraphCalibrationOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Above("loss_scale", loss_scale, 0)
      .AtLeast("max_num_iterations", max_num_iterations, 1)
      .Above("start_log_stddev", start_log_stddev, 0)
      .Within("min_focal_ratio", min_focal_ratio, 1e-3, 0.999)
      .Within("max_focal_ratio", max_focal_ratio, 1.001, 1e3)
      .AreKept();
}

std::vector<char> CalibrateViewGraph(const std::vector<PairFundamental>& pairs,
                                     const std::vector<char>& known,
                                     const ViewGraphCalibrationOptions& options,
                                     std::vector<double>* focal_lengths_px) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  CheckInput(pairs, known, *focal_lengths_px);

  ceres::Problem problem;
  // Relative to the start, which is the unit of each camera's coordinates.
  std::vector<double> log_ratios(known.size(), 0);
  for (const PairFundamental& pair : pairs) {
    if (known[pair.camera1] && known[pair.camera2]) continue;
    const bool same_camera = pair.camera1 == pair.camera2;
    std::vector<double*> parameters = {&log_ratios[pair.camera1]};
    if (!same_camera) parameters.push_back(&log_ratios[pair.camera2]);
    problem.AddResidualBlock(
        KruppaCostFunctor::Create(pair.F,
                                  (*focal_lengths_px)[pair.camera1],
                                  (*focal_lengths_px)[pair.camera2],
                                  same_camera),
        new ceres::CauchyLoss(options.loss_scale),
        parameters);
  }
  const double min_log_ratio = std::log(options.min_focal_ratio);
  const double max_log_ratio = std::log(options.max_focal_ratio);
  std::vector<char> estimated(known.size(), 0);
  for (size_t i = 0; i < known.size(); ++i) {
    double* log_ratio = &log_ratios[i];
    if (!problem.HasParameterBlock(log_ratio)) continue;
    problem.SetParameterLowerBound(log_ratio, 0, min_log_ratio);
    problem.SetParameterUpperBound(log_ratio, 0, max_log_ratio);
    problem.AddResidualBlock(
        new ceres::NormalPrior(
            Eigen::MatrixXd::Constant(
                1, 1, options.loss_scale / options.start_log_stddev),
            Eigen::VectorXd::Zero(1)),
        nullptr,
        log_ratio);
    if (known[i]) problem.SetParameterBlockConstant(log_ratio);
    estimated[i] = !known[i];
  }
  if (!Solve(options.max_num_iterations, &problem)) {
    return std::vector<char>(known.size(), 0);
  }

  for (size_t i = 0; i < known.size(); ++i) {
    estimated[i] = estimated[i] &&
                   log_ratios[i] > min_log_ratio + kBoundMargin &&
                   log_ratios[i] < max_log_ratio - kBoundMargin;
    if (estimated[i]) (*focal_lengths_px)[i] *= std::exp(log_ratios[i]);
  }
  return estimated;
}

}  // namespace dgsfm
