#include "sfm/georeferencing/model_alignment.h"

#include "colmap_ext/pose_access.h"
#include "estimators/median.h"
#include "sfm/mapping/metric_scale.h"
#include "sfm/mapping/model_access.h"

#include <colmap/base/similarity_transform.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>

namespace dgsfm {

namespace {

// The vertical by gravity, and by cameras held level, is off by this [deg].
constexpr double kGravityStddevDeg = 2;
constexpr double kLevelStddevDeg = 5;

// Median error over the extent of the positions at which these contradict the
// shape of a model.
constexpr double kMaxErrorShare = 0.3;

// Positions of the registered images, in the order of their ids.
std::vector<colmap::image_t> ImagesWithPosition(
    const PosePriors& priors, const colmap::Reconstruction& model) {
  std::vector<colmap::image_t> image_ids;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    const auto prior = priors.find(image_id);
    if (prior != priors.end() && prior->second.HasPosition()) {
      image_ids.push_back(image_id);
    }
  }
  return image_ids;
}

// Median horizontal distance of the positions from their median [m].
double ExtentOf(const PosePriors& priors, const colmap::Reconstruction& model) {
  std::vector<double> xs, ys, distances;
  for (const auto& [image_id, prior] : priors) {
    if (!prior.HasPosition() || !model.ExistsImage(image_id) ||
        !model.IsImageRegistered(image_id)) {
      continue;
    }
    xs.push_back(prior.position.x());
    ys.push_back(prior.position.y());
  }
  const double x = Median(xs), y = Median(ys);
  for (size_t i = 0; i < xs.size(); ++i) {
    distances.push_back(std::hypot(xs[i] - x, ys[i] - y));
  }
  return Median(distances);
}

// Median distance of the centres from the positions in the frame of these [m].
double MedianErrorOf(const PositionAlignment& alignment,
                     const PosePriors& priors,
                     const colmap::Reconstruction& model) {
  std::vector<double> errors;
  for (const auto& [image_id, center] : CentersOf(model)) {
    const auto prior = priors.find(image_id);
    if (prior == priors.end() || !prior->second.HasPosition()) continue;
    errors.push_back(
        (alignment.target_from_source * center - prior->second.position)
            .norm());
  }
  return Median(errors);
}

Eigen::Vector3d CenterOf(const colmap::Reconstruction& model,
                         colmap::image_t image_id) {
  return CamFromWorld(model.Image(image_id)).TargetOriginInSource();
}

std::vector<PositionMatch> MatchesOf(const PosePriors& priors,
                                     const colmap::Reconstruction& model) {
  std::vector<PositionMatch> matches;
  for (const colmap::image_t image_id : ImagesWithPosition(priors, model)) {
    const PosePrior& prior = priors.at(image_id);
    matches.push_back({CenterOf(model, image_id),
                       prior.position,
                       SqrtInformation(prior.covariance)});
  }
  return matches;
}

std::optional<DirectionMatch> VerticalOf(const GeoreferencingOptions& options,
                                         const PosePriors& priors,
                                         const colmap::Reconstruction& model) {
  const auto found = UpOfModel(options, priors, model);
  if (!found) return std::nullopt;
  DirectionMatch up;
  up.source = found->in_world;
  up.stddev_rad =
      (found->is_by_gravity ? kGravityStddevDeg : kLevelStddevDeg) * M_PI / 180;
  return up;
}

// Whether not all have the same position in one of the two frames.
bool HaveExtent(const std::vector<PositionMatch>& matches,
                Eigen::Vector3d PositionMatch::*position) {
  return std::any_of(
      matches.begin(), matches.end(), [&](const PositionMatch& match) {
        return match.*position != matches.front().*position;
      });
}

}  // namespace

void ModelGeoreference::MeasureErrors() {
  if (errors.empty()) return;
  std::vector<double> horizontal, vertical;
  for (const auto& [image_id, error] : errors) {
    horizontal.push_back(error.head<2>().norm());
    vertical.push_back(std::abs(error.z()));
  }
  median_horizontal_error_m = Median(std::move(horizontal));
  median_vertical_error_m = Median(std::move(vertical));
}

void ModelGeoreference::SetAlignment(const PositionAlignment& alignment) {
  num_positions = alignment.errors.size();
  num_inliers = alignment.num_inliers;
  spread = alignment.spread;
  log_scale_stddev_of_positions = alignment.log_scale_stddev;
  rotation_stddev_deg = alignment.rotation_stddev_rad * 180 / M_PI;
}

void ModelGeoreference::SetErrors(const PosePriors& priors,
                                  const colmap::Reconstruction& model) {
  for (const auto& [image_id, center] : CentersOf(model)) {
    const auto prior = priors.find(image_id);
    if (prior == priors.end() || !prior->second.HasPosition()) continue;
    errors[image_id] = center - prior->second.position;
  }
  MeasureErrors();
}

std::string ScaleSourceName(ScaleSource source) {
  switch (source) {
    case ScaleSource::NONE:
      return "none";
    case ScaleSource::POSITIONS:
      return "positions";
    case ScaleSource::DEPTH:
      return "depth";
    case ScaleSource::RIGS:
      return "rigs";
  }
  return "unknown";
}

Eigen::Matrix3d SqrtInformation(const Eigen::Matrix3d& covariance) {
  const Eigen::Matrix3d lower = covariance.llt().matrixL();
  return lower.inverse();
}

bool HasPositions(const PosePriors& priors) {
  return std::any_of(priors.begin(), priors.end(), [](const auto& prior) {
    return prior.second.HasPosition();
  });
}

std::string WhyUnusable(const GeoreferencingOptions& options,
                        const PosePriors& priors,
                        const std::optional<PositionAlignment>& alignment,
                        const colmap::Reconstruction& model) {
  const std::vector<PositionMatch> matches = MatchesOf(priors, model);
  if (matches.size() < 3) {
    return "only " + std::to_string(matches.size()) +
           " of these have one, and three are needed";
  }
  if (!HaveExtent(matches, &PositionMatch::target)) {
    return "all have the same";
  }
  if (!HaveExtent(matches, &PositionMatch::source)) {
    return "the images are at one place, which leaves the scale open";
  }
  const bool is_scale_open = alignment && !(alignment->log_scale_stddev <=
                                            options.max_log_scale_stddev);
  // By the errors that were given; larger ones show a contradiction.
  if (is_scale_open &&
      !(alignment->log_scale_stddev <=
        std::max(1.0, alignment->spread) * options.max_log_scale_stddev)) {
    return "they differ by hardly more than their errors, which leaves the "
           "scale open";
  }
  if (!alignment || is_scale_open ||
      MedianErrorOf(*alignment, priors, model) >
          kMaxErrorShare * ExtentOf(priors, model)) {
    const size_t num_agreeing =
        CountAgreeing({}, matches, VerticalOf(options, priors, model));
    return "they contradict the shape of the model, with which " +
           std::to_string(num_agreeing) + " of " +
           std::to_string(matches.size()) +
           " agree. Check that they belong to the images, that latitude and "
           "longitude are not swapped, and leave those out that are wrong";
  }
  return "";
}

std::string UnusablePositionsText(const std::string& reason,
                                  const colmap::Reconstruction& model) {
  return "The positions of the images are not used for a model of " +
         std::to_string(model.NumRegImages()) + " images: " + reason;
}

std::optional<UpDirection> UpOfModel(const GeoreferencingOptions& options,
                                     const PosePriors& priors,
                                     const colmap::Reconstruction& model) {
  std::vector<LevelCamera> cameras;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    LevelCamera& camera = cameras.emplace_back();
    camera.cam_from_world = CamFromWorld(model.Image(image_id)).rotation;
    const auto prior = priors.find(image_id);
    if (prior != priors.end()) camera.gravity = prior->second.gravity;
  }
  return FindUpDirection(options.up_direction, cameras);
}

std::optional<PositionAlignment> AlignToPositions(
    const GeoreferencingOptions& options,
    const PosePriors& priors,
    const std::optional<double>& scale,
    const colmap::Reconstruction& model) {
  PositionAlignmentOptions alignment;
  alignment.loss_scale = options.loss_scale;
  alignment.fixed_scale = scale;
  return AlignPositions(
      alignment, MatchesOf(priors, model), VerticalOf(options, priors, model));
}

void TransformModel(const Similarity3d& new_from_old,
                    colmap::Reconstruction* model) {
  model->Transform(
      colmap::SimilarityTransform3(new_from_old.scale,
                                   QvecFromRotation(new_from_old.rotation),
                                   new_from_old.translation));
}

CenterPriors CenterPriorsOf(const GeoreferencingOptions& options,
                            const PosePriors& priors,
                            double stddev_factor,
                            const colmap::Reconstruction& model) {
  CenterPriors result;
  result.loss_scale = options.loss_scale;
  for (const colmap::image_t image_id : ImagesWithPosition(priors, model)) {
    const PosePrior& prior = priors.at(image_id);
    result.centers[image_id] = {
        prior.position, SqrtInformation(prior.covariance) / stddev_factor};
  }
  return result;
}

std::vector<double> CenterErrors(const CenterPriors& priors,
                                 const colmap::Reconstruction& model) {
  std::vector<double> errors;
  for (const auto& [image_id, prior] : priors.centers) {
    errors.push_back(
        (prior.sqrt_information * (CenterOf(model, image_id) - prior.center))
            .norm());
  }
  return errors;
}

}  // namespace dgsfm
