#include "estimators/averaging/focal_averaging.h"

#include "colmap_ext/check.h"
#include "estimators/intrinsics/kruppa_cost.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

namespace dgsfm {
namespace {

struct WeightedValue {
  double value;
  double weight;
};

// Value below and above which half of the weight lies; the mean of two where
// any value between them does. Values must not be empty.
double WeightedMedian(std::vector<WeightedValue> values) {
  std::sort(values.begin(), values.end(), [](const auto& a, const auto& b) {
    return a.value < b.value;
  });
  double total = 0;
  for (const WeightedValue& value : values) total += value.weight;
  double sum = 0;
  for (size_t i = 0; i + 1 < values.size(); ++i) {
    sum += values[i].weight;
    if (2 * sum > total) return values[i].value;
    if (2 * sum == total) return (values[i].value + values[i + 1].value) / 2;
  }
  return values.back().value;
}

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
    DGSFM_CHECK(std::isfinite(pair.weight) && pair.weight > 0)
        << "weight = " << pair.weight;
  }
}

}  // namespace

std::optional<AveragedFocal> AverageFocals(
    const std::vector<FocalEstimate>& estimates) {
  if (estimates.empty()) return std::nullopt;
  std::vector<WeightedValue> values;
  for (const FocalEstimate& estimate : estimates) {
    DGSFM_CHECK(std::isfinite(estimate.focal_length_px) &&
                estimate.focal_length_px > 0)
        << "focal length = " << estimate.focal_length_px;
    DGSFM_CHECK(std::isfinite(estimate.weight) && estimate.weight > 0)
        << "weight = " << estimate.weight;
    values.push_back({std::log(estimate.focal_length_px), estimate.weight});
  }
  const double median = WeightedMedian(values);
  for (WeightedValue& value : values) {
    value.value = std::abs(value.value - median);
  }
  return AveragedFocal{std::exp(median),
                       kStddevPerMad * WeightedMedian(values)};
}

bool ViewGraphCalibrationOptions::IsValid(std::string* error) const {
  return CheckOption(
             loss_scale > 0, "loss_scale must be > 0", loss_scale, error) &&
         CheckOption(max_num_iterations >= 1,
                     "max_num_iterations must be >= 1",
                     max_num_iterations,
                     error) &&
         CheckOption(start_log_stddev > 0,
                     "start_log_stddev must be > 0",
                     start_log_stddev,
                     error) &&
         CheckOption(min_focal_ratio > 0 && min_focal_ratio < 1,
                     "min_focal_ratio must be in (0, 1)",
                     min_focal_ratio,
                     error) &&
         CheckOption(max_focal_ratio > 1 && std::isfinite(max_focal_ratio),
                     "max_focal_ratio must be > 1 and finite",
                     max_focal_ratio,
                     error);
}

std::vector<char> CalibrateViewGraph(const std::vector<PairFundamental>& pairs,
                                     const std::vector<char>& known,
                                     const ViewGraphCalibrationOptions& options,
                                     std::vector<double>* focal_lengths_px) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  CheckInput(pairs, known, *focal_lengths_px);

  ceres::CauchyLoss cauchy_loss(options.loss_scale);
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
        new ceres::ScaledLoss(
            &cauchy_loss, pair.weight, ceres::DO_NOT_TAKE_OWNERSHIP),
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
