#include "estimators/intrinsics/camera_grouping.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <Eigen/Cholesky>

namespace dgsfm {

namespace {

// Bisections of the interval of a group's variance.
constexpr int kNumBisections = 40;

struct FocalCluster {
  std::vector<int> cameras;
  double mean = 0;
  double variance = 0;
};

// Logarithm of the odds that two clusters have one focal length.
double LogOdds(const CameraGroupingOptions& options,
               const FocalCluster& cluster1,
               const FocalCluster& cluster2) {
  const double squared_difference =
      (cluster1.mean - cluster2.mean) * (cluster1.mean - cluster2.mean);
  const double variance_same = cluster1.variance + cluster2.variance;
  const double variance_different =
      variance_same + 2 * options.log_focal_stddev * options.log_focal_stddev;
  return std::log(options.prior_odds) +
         0.5 * (std::log(variance_different / variance_same) +
                squared_difference *
                    (1 / variance_different - 1 / variance_same));
}

FocalCluster Join(const FocalCluster& cluster1, const FocalCluster& cluster2) {
  FocalCluster joint;
  joint.cameras = cluster1.cameras;
  joint.cameras.insert(
      joint.cameras.end(), cluster2.cameras.begin(), cluster2.cameras.end());
  const double weight1 = double(cluster1.cameras.size()) / cluster1.variance;
  const double weight2 = double(cluster2.cameras.size()) / cluster2.variance;
  joint.mean =
      (weight1 * cluster1.mean + weight2 * cluster2.mean) / (weight1 + weight2);
  // Errors have causes in common, and do not average out.
  joint.variance = double(joint.cameras.size()) / (weight1 + weight2);
  return joint;
}

// One parameter of some cameras.
struct Values {
  Eigen::VectorXd values;
  Eigen::MatrixXd covariance;
};

Values ValuesOf(const CameraEstimates& estimates,
                const std::vector<int>& cameras,
                int param) {
  const auto count = Eigen::Index(cameras.size());
  Values values = {Eigen::VectorXd(count), Eigen::MatrixXd(count, count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const int row = cameras[i] * estimates.num_params_per_camera + param;
    values.values(i) = estimates.params(row);
    for (Eigen::Index j = 0; j < count; ++j) {
      values.covariance(i, j) = estimates.covariance(
          row, cameras[j] * estimates.num_params_per_camera + param);
    }
  }
  return values;
}

// Variances are those of the differences from the mean of all: what errors
// have in common does not tell cameras apart.
std::vector<FocalCluster> SingleClusters(const CameraGroupingOptions& options,
                                         const CameraEstimates& estimates,
                                         const std::vector<int>& cameras) {
  const Values focals = ValuesOf(estimates, cameras, 0);
  Eigen::VectorXd weights = focals.covariance.diagonal().cwiseInverse();
  weights /= weights.sum();
  const Eigen::VectorXd cross = focals.covariance * weights;
  const double mean_variance = weights.dot(cross);
  std::vector<FocalCluster> clusters;
  for (Eigen::Index i = 0; i < focals.values.size(); ++i) {
    const double variance =
        std::max(focals.covariance(i, i) - 2 * cross(i) + mean_variance, 0.0);
    clusters.push_back({{cameras[i]},
                        focals.values(i),
                        variance + options.min_log_focal_stddev *
                                       options.min_log_focal_stddev});
  }
  return clusters;
}

// By focal length alone.
std::vector<FocalCluster> ClusterFocals(const CameraGroupingOptions& options,
                                        std::vector<FocalCluster> clusters) {
  std::stable_sort(
      clusters.begin(), clusters.end(), [](const auto& a, const auto& b) {
        return a.mean < b.mean;
      });
  while (clusters.size() > 1) {
    size_t best = 0;
    double best_log_odds = -1;
    for (size_t i = 0; i + 1 < clusters.size(); ++i) {
      const double log_odds = LogOdds(options, clusters[i], clusters[i + 1]);
      if (log_odds > best_log_odds) {
        best = i;
        best_log_odds = log_odds;
      }
    }
    if (best_log_odds < 0) break;
    clusters[best] = Join(clusters[best], clusters[best + 1]);
    clusters.erase(clusters.begin() + int(best) + 1);
  }
  return clusters;
}

// Quantile of chi-square for an upper tail (Wilson and Hilferty 1931).
double ChiSquareQuantile(int degrees_of_freedom, double tail) {
  // Quantile of the normal distribution (Abramowitz and Stegun 26.2.23).
  const double t = std::sqrt(-2 * std::log(tail));
  const double normal =
      t - (2.515517 + t * (0.802853 + t * 0.010328)) /
              (1 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
  const double width = 2.0 / (9.0 * degrees_of_freedom);
  return degrees_of_freedom *
         std::pow(1 - width + normal * std::sqrt(width), 3);
}

// Cochran's Q: chi-square of the values about their best common mean.
double SpreadStatistic(const Values& values, double variance) {
  Eigen::MatrixXd covariance = values.covariance;
  covariance.diagonal().array() += variance;
  const Eigen::LDLT<Eigen::MatrixXd> factors(covariance);
  const auto ones = Eigen::VectorXd::Ones(values.values.size());
  const Eigen::VectorXd weighted_ones = factors.solve(ones);
  const double mean =
      weighted_ones.dot(values.values) / weighted_ones.dot(ones);
  const Eigen::VectorXd differences = values.values - mean * ones;
  return differences.dot(factors.solve(differences));
}

// Squared difference of a value from the best mean of the others over its
// variance, conditioned on all correlations: the decrease of Q when the value
// is left out.
double SquaredDistanceFromOthers(const Values& values, size_t index) {
  const Eigen::LDLT<Eigen::MatrixXd> factors(values.covariance);
  const auto size = values.values.size();
  const Eigen::VectorXd ones = Eigen::VectorXd::Ones(size);
  const Eigen::VectorXd unit = Eigen::VectorXd::Unit(size, Eigen::Index(index));
  // A free offset of this value, and its estimate, in a linear model.
  const Eigen::VectorXd weighted_ones = factors.solve(ones);
  const Eigen::VectorXd weighted_unit = factors.solve(unit);
  const Eigen::VectorXd residuals =
      values.values -
      weighted_ones.dot(values.values) / weighted_ones.dot(ones) * ones;
  const double information = weighted_unit.dot(unit) -
                             weighted_unit.dot(ones) * weighted_unit.dot(ones) /
                                 weighted_ones.dot(ones);
  const double projection = weighted_unit.dot(residuals);
  return information > 0 ? projection * projection / information : 0;
}

// The spread of one parameter that errors do not explain (Paule and Mandel
// 1982); zero if they do.
double ExcessStddev(const CameraGroupingOptions& options,
                    const Values& values) {
  const int degrees_of_freedom = int(values.values.size()) - 1;
  if (SpreadStatistic(values, 0) <=
      ChiSquareQuantile(degrees_of_freedom, options.spread_significance)) {
    return 0;
  }
  double lower = 0;
  double upper = (values.values.array() - values.values.mean()).square().sum();
  for (int i = 0; i < kNumBisections; ++i) {
    const double middle = (lower + upper) / 2;
    const bool is_too_small =
        SpreadStatistic(values, middle) > degrees_of_freedom;
    (is_too_small ? lower : upper) = middle;
  }
  return std::sqrt(upper);
}

// Takes out cameras whose parameters beside the focal length differ from those
// of the others.
void RemoveDifferent(const CameraGroupingOptions& options,
                     const CameraEstimates& estimates,
                     std::vector<int>* cameras) {
  const double max_distance = ChiSquareQuantile(
      1, options.significance / double(estimates.params.size()));
  while (cameras->size() > 1) {
    double worst_distance = 0;
    size_t worst = 0;
    for (int param = 1; param < estimates.num_params_per_camera; ++param) {
      const Values values = ValuesOf(estimates, *cameras, param);
      for (size_t i = 0; i < cameras->size(); ++i) {
        const double distance = SquaredDistanceFromOthers(values, i);
        if (distance > worst_distance) {
          worst_distance = distance;
          worst = i;
        }
      }
    }
    if (worst_distance <= max_distance) break;
    cameras->erase(cameras->begin() + int(worst));
  }
}

// That all have one focal length.
double LogOddsOf(const CameraGroupingOptions& options,
                 const std::vector<FocalCluster>& singles) {
  double sum = 0;
  FocalCluster joint = singles[0];
  for (size_t i = 1; i < singles.size(); ++i) {
    sum += LogOdds(options, joint, singles[i]);
    joint = Join(joint, singles[i]);
  }
  return sum;
}

// Takes cameras that differ out of a cluster, splits the rest by focal length
// once more, and adds the groups that are likely enough.
void AddGroups(const CameraGroupingOptions& options,
               const CameraEstimates& estimates,
               std::vector<int> cameras,
               std::vector<SameCameras>* groups) {
  RemoveDifferent(options, estimates, &cameras);
  for (const FocalCluster& cluster :
       ClusterFocals(options, SingleClusters(options, estimates, cameras))) {
    const double log_odds =
        LogOddsOf(options, SingleClusters(options, estimates, cluster.cameras));
    if (cluster.cameras.size() < size_t(options.min_num_cameras) ||
        log_odds < std::log(options.min_odds)) {
      continue;
    }
    SameCameras group;
    group.cameras = cluster.cameras;
    std::sort(group.cameras.begin(), group.cameras.end());
    group.log_odds = log_odds;
    group.stddevs.resize(estimates.num_params_per_camera);
    for (int i = 0; i < estimates.num_params_per_camera; ++i) {
      group.stddevs(i) =
          ExcessStddev(options, ValuesOf(estimates, group.cameras, i));
    }
    groups->push_back(group);
  }
}

}  // namespace

bool CameraGroupingOptions::IsValid(std::string* error) const {
  return CheckOption(log_focal_stddev > 0,
                     "log_focal_stddev must be > 0",
                     log_focal_stddev,
                     error) &&
         CheckOption(min_log_focal_stddev > 0,
                     "min_log_focal_stddev must be > 0",
                     min_log_focal_stddev,
                     error) &&
         CheckOption(
             prior_odds > 0, "prior_odds must be > 0", prior_odds, error) &&
         CheckOption(min_odds > 0, "min_odds must be > 0", min_odds, error) &&
         CheckOption(min_num_cameras >= 2,
                     "min_num_cameras must be >= 2",
                     min_num_cameras,
                     error) &&
         CheckOption(significance > 0 && significance < 0.5,
                     "significance must be in (0, 0.5)",
                     significance,
                     error) &&
         CheckOption(spread_significance > 0 && spread_significance < 0.5,
                     "spread_significance must be in (0, 0.5)",
                     spread_significance,
                     error);
}

std::vector<std::vector<int>> ClusterByFocal(
    const CameraGroupingOptions& options, const CameraEstimates& estimates) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(estimates.num_params_per_camera > 0 &&
              estimates.params.size() % estimates.num_params_per_camera == 0);
  DGSFM_CHECK(estimates.covariance.rows() == estimates.params.size() &&
              estimates.covariance.cols() == estimates.params.size());
  std::vector<int> cameras(estimates.params.size() /
                           estimates.num_params_per_camera);
  std::iota(cameras.begin(), cameras.end(), 0);
  std::vector<std::vector<int>> clusters;
  for (FocalCluster& cluster :
       ClusterFocals(options, SingleClusters(options, estimates, cameras))) {
    if (cluster.cameras.size() < 2) continue;
    std::sort(cluster.cameras.begin(), cluster.cameras.end());
    clusters.push_back(std::move(cluster.cameras));
  }
  return clusters;
}

std::vector<SameCameras> GroupCameras(const CameraGroupingOptions& options,
                                      const CameraEstimates& estimates) {
  std::vector<SameCameras> groups;
  for (const std::vector<int>& cameras : ClusterByFocal(options, estimates)) {
    AddGroups(options, estimates, cameras, &groups);
  }
  std::sort(groups.begin(), groups.end(), [](const auto& a, const auto& b) {
    return a.cameras < b.cameras;
  });
  return groups;
}

double LogOddsOfDeviation(const CameraDeviation& deviation,
                          double prior_stddev) {
  const auto size = deviation.values.size();
  DGSFM_CHECK(deviation.covariance.rows() == size &&
              deviation.covariance.cols() == size);
  const auto log_likelihood = [&](const Eigen::MatrixXd& covariance) {
    const Eigen::LDLT<Eigen::MatrixXd> factors(covariance);
    return -0.5 * (factors.vectorD().array().log().sum() +
                   deviation.values.dot(factors.solve(deviation.values)));
  };
  return log_likelihood(deviation.covariance +
                        prior_stddev * prior_stddev *
                            Eigen::MatrixXd::Identity(size, size)) -
         log_likelihood(deviation.covariance);
}

std::vector<char> DeviatingCameras(
    const CameraGroupingOptions& options,
    const std::vector<CameraDeviation>& deviations) {
  std::vector<char> deviating(deviations.size(), 0);
  for (size_t i = 0; i < deviations.size(); ++i) {
    const Eigen::VectorXd& values = deviations[i].values;
    DGSFM_CHECK(values.size() > 0 &&
                deviations[i].covariance.rows() == values.size() &&
                deviations[i].covariance.cols() == values.size());
    const double chi_square =
        values.dot(deviations[i].covariance.ldlt().solve(values));
    deviating[i] =
        chi_square >
        ChiSquareQuantile(int(values.size()),
                          options.significance / double(deviations.size()));
  }
  return deviating;
}

}  // namespace dgsfm
