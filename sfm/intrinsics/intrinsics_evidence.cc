#include "sfm/intrinsics/intrinsics_evidence.h"

#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <glog/logging.h>

namespace dgsfm {

namespace {

// Spread of log focal lengths of one camera, by focusing and by errors that
// neighbouring images have in common [1].
constexpr double kMinLogFocalStddev = 0.005;
// Images whose focal lengths are farther from the mean of those that share one
// have one of their own [standard deviations]; so have all of them if the root
// of their mean squared deviation is larger than the second value. It is 0.2 to
// 1.4 on photos of one camera.
constexpr double kMaxFocalDeviation = 6;
constexpr double kMaxRmsFocalDeviation = 2;
// Probability that any principal point of a model is taken for that of a crop
// by mistake [1].
constexpr double kCropSignificance = 1e-3;
// Standard deviation of a principal point by the observations, over that of its
// prior, up to which it counts as determined: they then have twice the
// information of the prior.
constexpr double kMaxUncertaintyRatio = M_SQRT1_2;
// ... and if the key points prefer them to the given ones by 20 to 1 [nat].
constexpr double kMinLogOdds = 3;

// Differences of values from their weighted mean, over their standard
// deviations [1], which are at least kMinLogFocalStddev.
Eigen::VectorXd DeviationsFromMean(const Eigen::VectorXd& values,
                                   const Eigen::MatrixXd& covariance) {
  Eigen::VectorXd weights = covariance.diagonal().cwiseInverse();
  weights /= weights.sum();
  const Eigen::VectorXd cross = covariance * weights;
  const double mean = weights.dot(values);
  const Eigen::ArrayXd variances =
      (covariance.diagonal() - 2 * cross).array() + weights.dot(cross);
  return (values.array() - mean) /
         (variances.max(0) + kMinLogFocalStddev * kMinLogFocalStddev).sqrt();
}

// Deviation of some parameters of a camera, its principal point or its
// distortion, from the given ones [px, 1].
struct ParamsDeviation {
  Eigen::VectorXd offset;
  // By all errors, and by those of single key points.
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd keypoint_covariance;

  double ChiSquare() const { return offset.dot(covariance.inverse() * offset); }
};

// Nothing where a parameter is held, or there is none.
std::optional<ParamsDeviation> DeviationOf(
    const std::vector<size_t>& idxs,
    const colmap::Camera& camera,
    const colmap::Camera& given,
    Eigen::Index first_param,
    const IntrinsicsPosterior& posterior) {
  const auto count = Eigen::Index(idxs.size());
  if (count == 0) return std::nullopt;
  ParamsDeviation deviation = {Eigen::VectorXd(count),
                               Eigen::MatrixXd(count, count),
                               Eigen::MatrixXd(count, count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const size_t row = idxs[size_t(i)];
    deviation.offset(i) = camera.Params(row) - given.Params(row);
    for (Eigen::Index j = 0; j < count; ++j) {
      const Eigen::Index param1 = first_param + Eigen::Index(row);
      const Eigen::Index param2 = first_param + Eigen::Index(idxs[size_t(j)]);
      deviation.covariance(i, j) = posterior.covariance(param1, param2);
      deviation.keypoint_covariance(i, j) =
          posterior.keypoint_covariance(param1, param2);
    }
  }
  if (!(deviation.covariance.diagonal().minCoeff() > 0)) return std::nullopt;
  return deviation;
}

// Deviations of all cameras, of groups those of their first, that have any.
std::map<colmap::camera_t, ParamsDeviation> DeviationsOf(
    const std::vector<size_t>& (colmap::Camera::*idxs)() const,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model) {
  std::map<colmap::camera_t, ParamsDeviation> deviations;
  for (const auto& [camera_id, first_param] : posterior.first_params) {
    const colmap::Camera& given = beliefs.given.at(camera_id);
    const auto deviation = DeviationOf((given.*idxs)(),
                                       model.Camera(camera_id),
                                       given,
                                       first_param,
                                       posterior);
    if (deviation) deviations.emplace(camera_id, *deviation);
  }
  return deviations;
}

// Standard deviation in the least certain direction.
double MaxStddev(const Eigen::MatrixXd& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(covariance);
  return std::sqrt(eigen.eigenvalues().maxCoeff());
}

// Logarithm of the odds, even ones before, that parameters are drawn from their
// prior, and are not the given ones with errors of key points.
double LogOddsOfPrior(const ParamsDeviation& deviation, double prior_stddev) {
  const auto log_likelihood = [&](const Eigen::MatrixXd& covariance) {
    return -0.5 *
           (std::log(covariance.determinant()) +
            deviation.offset.dot(covariance.inverse() * deviation.offset));
  };
  const Eigen::Index count = deviation.offset.size();
  return log_likelihood(deviation.keypoint_covariance +
                        prior_stddev * prior_stddev *
                            Eigen::MatrixXd::Identity(count, count)) -
         log_likelihood(deviation.keypoint_covariance);
}

// Images by the first camera of each group.
std::map<colmap::camera_t, std::vector<colmap::image_t>> ByGroup(
    const std::vector<colmap::image_t>& image_ids,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  std::map<colmap::camera_t, std::vector<colmap::image_t>> images;
  for (const colmap::image_t image_id : image_ids) {
    images[beliefs.FirstOfGroup(model.Image(image_id).CameraId())].push_back(
        image_id);
  }
  return images;
}

// Cameras of the groups that are chosen by their first camera.
template <typename IsChosen>
std::set<colmap::camera_t> CamerasOf(const CameraBeliefs& beliefs,
                                     const colmap::Reconstruction& model,
                                     const IsChosen& is_chosen) {
  std::set<colmap::camera_t> chosen;
  for (const auto& [camera_id, camera] : model.Cameras()) {
    if (is_chosen(beliefs.FirstOfGroup(camera_id))) chosen.insert(camera_id);
  }
  return chosen;
}

}  // namespace

std::vector<colmap::image_t> FindDeviatingImages(
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& by_image,
    const colmap::Reconstruction& model) {
  // Where the focal length is refined.
  std::vector<colmap::image_t> judged;
  for (const auto& [image_id, param] : by_image.first_params) {
    if (by_image.covariance(param, param) != 0) judged.push_back(image_id);
  }
  const auto images_of = ByGroup(model.RegImageIds(), beliefs, model);
  std::vector<colmap::image_t> deviating;
  for (const auto& [camera_id, image_ids] : ByGroup(judged, beliefs, model)) {
    if (image_ids.size() < 2) continue;
    const double focal_px = model.Camera(camera_id).MeanFocalLength();
    const auto count = Eigen::Index(image_ids.size());
    Eigen::VectorXd logs(count);
    Eigen::MatrixXd covariance(count, count);
    for (Eigen::Index i = 0; i < count; ++i) {
      const Eigen::Index param1 =
          by_image.first_params.at(image_ids[size_t(i)]);
      // The step of the logarithm.
      logs(i) = by_image.params(param1) / focal_px - 1;
      for (Eigen::Index j = 0; j < count; ++j) {
        const Eigen::Index param2 =
            by_image.first_params.at(image_ids[size_t(j)]);
        covariance(i, j) =
            by_image.covariance(param1, param2) / (focal_px * focal_px);
      }
    }
    const Eigen::VectorXd deviations = DeviationsFromMean(logs, covariance);
    const double rms = std::sqrt(deviations.squaredNorm() / double(count));
    VLOG(1) << "Camera " << camera_id << ": focal lengths of " << count
            << " images differ by " << rms << " standard deviations, at most "
            << deviations.cwiseAbs().maxCoeff();
    if (rms > kMaxRmsFocalDeviation) {
      const std::vector<colmap::image_t>& all = images_of.at(camera_id);
      deviating.insert(deviating.end(), all.begin(), all.end());
      continue;
    }
    for (Eigen::Index i = 0; i < count; ++i) {
      if (std::abs(deviations(i)) > kMaxFocalDeviation) {
        deviating.push_back(image_ids[size_t(i)]);
      }
    }
  }
  std::sort(deviating.begin(), deviating.end());
  return deviating;
}

std::set<colmap::camera_t> FindHeldPrincipalPoints(
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model) {
  const auto images_of = ByGroup(model.RegImageIds(), beliefs, model);
  const auto deviations = DeviationsOf(
      &colmap::Camera::PrincipalPointIdxs, beliefs, posterior, model);
  // The distribution of chi-square with two degrees of freedom is exponential.
  const double max_chi_square =
      -2 * std::log(kCropSignificance / double(deviations.size()));
  std::set<colmap::camera_t> freed;
  for (const auto& [camera_id, deviation] : deviations) {
    const double stddev_px = prior.principal_point_stddev_ratio *
                             LargerSide(beliefs.given.at(camera_id));
    const double uncertainty = MaxStddev(deviation.covariance) / stddev_px;
    const double log_odds = LogOddsOfPrior(deviation, stddev_px);
    VLOG(1) << "Principal point of camera " << camera_id << ": uncertainty "
            << uncertainty << " of the prior's, off by "
            << deviation.offset.transpose() << " px, log odds " << log_odds;
    const bool is_crop =
        deviation.ChiSquare() > max_chi_square &&
        deviation.offset.norm() > prior.crop_factor * stddev_px;
    const bool is_determined = images_of.at(camera_id).size() > 1 &&
                               uncertainty < kMaxUncertaintyRatio &&
                               log_odds > kMinLogOdds;
    if (is_crop || is_determined) freed.insert(camera_id);
  }
  return CamerasOf(beliefs, model, [&](colmap::camera_t first_id) {
    return freed.count(first_id) == 0;
  });
}

std::set<colmap::camera_t> FindHeldDistortions(
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model) {
  const auto images_of = ByGroup(model.RegImageIds(), beliefs, model);
  std::set<colmap::camera_t> held_firsts;
  for (auto& [camera_id, deviation] : DeviationsOf(
           &colmap::Camera::ExtraParamsIdxs, beliefs, posterior, model)) {
    const size_t num_images = images_of.at(camera_id).size();
    if (num_images < 2) continue;
    // Each of the other images has as much information as those that were
    // looked at.
    deviation.keypoint_covariance *=
        posterior.num_images.at(camera_id) / double(num_images);
    const double log_odds =
        LogOddsOfPrior(deviation, prior.extra_params_stddev);
    VLOG(1) << "Distortion of camera " << camera_id << ": "
            << deviation.offset.transpose() << ", log odds " << log_odds;
    if (log_odds < 0) held_firsts.insert(camera_id);
  }
  return CamerasOf(beliefs, model, [&](colmap::camera_t first_id) {
    return held_firsts.count(first_id) > 0;
  });
}

}  // namespace dgsfm
