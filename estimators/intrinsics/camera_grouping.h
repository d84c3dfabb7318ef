// Which of several self-calibrated cameras are one and the same.

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct CameraGroupingOptions {
  // Spread of log focal lengths of cameras that have nothing to do with each
  // other [1].
  double log_focal_stddev = 0.5;
  // Spread of log focal lengths of one camera, by focusing and by errors that
  // neighbouring images have in common [1].
  double min_log_focal_stddev = 0.005;
  // Odds, before their estimates are seen, that two cameras are the same [1].
  double prior_odds = 0.05;
  // Odds a group needs after that [1].
  double min_odds = 20;
  // Cameras a group has at least: so many rarely agree by chance.
  int min_num_cameras = 4;
  // Probability that a camera is taken from its group by mistake [1].
  double significance = 1e-3;
  // Images whose focal lengths are farther from the mean of those that share
  // one have one of their own [standard deviations]; so have all of them if the
  // root of their mean squared deviation is larger than the second value. It is
  // 0.2 to 1.4 on photos of one camera.
  double max_focal_deviation = 6;
  double max_rms_focal_deviation = 2;
  // Probability that the spread of a parameter that does not differ is taken
  // for one [1].
  double spread_significance = 1e-2;

  bool IsValid(std::string* error) const;
};

// Estimated parameters of cameras of one model and image size.
struct CameraEstimates {
  int num_params_per_camera = 0;
  // Parameters of one camera after the other, the logarithm of the focal length
  // first.
  Eigen::VectorXd params;
  Eigen::MatrixXd covariance;
};

struct SameCameras {
  // By index, ascending.
  std::vector<int> cameras;
  // Spread of each parameter about the group's mean, beyond that of errors:
  // zero for the same.
  Eigen::VectorXd stddevs;
  // That the focal length is the same, apart from that spread.
  double log_odds = 0;
};

// Disjoint groups of cameras that are the same or close to it.
//
// Neighbours in log focal length are joined, the likeliest first, while that is
// likelier than not: the Bayes factor of one focal length against two
// independent ones,
//   N(d; 0, v_1 + v_2) / N(d; 0, v_1 + v_2 + 2 log_focal_stddev^2),
// times prior_odds, d the difference of the means of two clusters and v their
// variances, which do not shrink with their size. Cameras that differ in other
// parameters leave their cluster (chi-square of a camera against the others
// under the joint covariance, the worst first), and the rest is clustered once
// more. A group
// whose members' odds multiply to less than min_odds, or that has fewer than
// min_num_cameras, is given up. Parameters
// that spread more than errors explain get the excess (Paule and Mandel).
//
// Throws on sizes that do not match. Deterministic.
std::vector<SameCameras> GroupCameras(const CameraGroupingOptions& options,
                                      const CameraEstimates& estimates);

// Which cameras may be the same by their focal lengths alone: clusters of two
// or more as in the first step of GroupCameras.
std::vector<std::vector<int>> ClusterByFocal(
    const CameraGroupingOptions& options, const CameraEstimates& estimates);

// Estimated deviations of a camera from what is given for it.
struct CameraDeviation {
  Eigen::VectorXd values;
  Eigen::MatrixXd covariance;
};

// Which cameras deviate from what is given by more than errors explain
// (chi-square, at options.significance for all cameras together).
std::vector<char> DeviatingCameras(
    const CameraGroupingOptions& options,
    const std::vector<CameraDeviation>& deviations);

// Logarithm of the odds, even ones before, that a deviation has a normal
// distribution of variance prior_stddev^2 in each value, and is not just an
// error.
double LogOddsOfDeviation(const CameraDeviation& deviation,
                          double prior_stddev);

}  // namespace dgsfm
