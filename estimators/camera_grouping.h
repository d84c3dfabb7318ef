// Which of several self-calibrated cameras are one and the same.

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct CameraGroupingOptions {
  // Variance of the estimates over what independent image errors explain [1],
  // at most: errors of one image have causes in common. Ties of real photos of
  // one camera cost 1.4 to 16 times what such errors explain.
  double max_variance_factor = 10;
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
  // Probability that the spread of a parameter that does not differ is taken
  // for one [1].
  double spread_significance = 1e-2;

  bool IsValid(std::string* error) const;
};

// Estimated parameters of cameras of one model and image size.
struct CameraEstimates {
  int num_params_per_camera = 0;
  // Of one camera after the other, the logarithm of the focal length first.
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
  // Variance of the estimates over what independent image errors explain.
  double variance_factor = 1;
};

// Disjoint groups of cameras that are the same or close to it.
//
// Neighbours in log focal length are joined, the likeliest first, while that is
// likelier than not: the Bayes factor of one focal length against two
// independent ones,
//   N(d; 0, v_1 + v_2) / N(d; 0, v_1 + v_2 + 2 log_focal_stddev^2),
// times prior_odds, d the difference of the means of two clusters and v their
// variances, which do not shrink with their size. First with
// max_variance_factor; then with the factor that the spread of the other
// parameters of a cluster shows (median of Cochran's Q over its degrees of
// freedom), once cameras that differ in them have left (chi-square of a camera
// against the others under the joint covariance, the worst first). A group
// whose members' odds multiply to less than min_odds, or that has fewer than
// min_num_cameras, is given up. Parameters
// that spread more than errors explain get the excess (Paule and Mandel).
//
// Throws on sizes that do not match. Deterministic.
std::vector<SameCameras> GroupCameras(const CameraGroupingOptions& options,
                                      const CameraEstimates& estimates);

// Which cameras may be the same by their focal lengths alone, judged with the
// largest variance factor: clusters of two or more as in the first step of
// GroupCameras.
std::vector<std::vector<int>> ClusterByFocal(
    const CameraGroupingOptions& options, const CameraEstimates& estimates);

// Estimated deviations of a camera from what is given for it.
struct CameraDeviation {
  Eigen::VectorXd values;
  Eigen::MatrixXd covariance;
};

// Which cameras deviate from what is given by more than errors with the largest
// variance factor explain (chi-square, at options.significance for all cameras
// together); all, if those that do not by themselves do so together.
std::vector<char> DeviatingCameras(
    const CameraGroupingOptions& options,
    const std::vector<CameraDeviation>& deviations);

// Whether errors explain what ties, which take so many unknowns away, add to
// the sum of squared errors, in units of their variance (likelihood ratio).
bool AreTiesPlausible(const CameraGroupingOptions& options,
                      double increase,
                      int num_ties);

// Logarithm of the odds, even ones before, that a deviation has a normal
// distribution of variance prior_stddev^2 in each value, and is not just an
// error, the covariance of which is variance_factor times the estimated one.
double LogOddsOfDeviation(const CameraDeviation& deviation,
                          double variance_factor,
                          double prior_stddev);

}  // namespace dgsfm
