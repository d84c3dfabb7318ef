#include "sfm/joining/block_adjustment.h"

#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "estimators/optimization/bundle_solver.h"
#include "estimators/optimization/camera_projection.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <glog/logging.h>

namespace dgsfm {

namespace {

constexpr int kNotInBlock = -1;

// The poses and indices that the adjustments of all blocks share.
class BlockAdjuster {
 public:
  BlockAdjuster(const BlockAdjustmentOptions& options,
                int num_threads,
                const RigConstraints& rigs,
                const CenterPriors& center_priors,
                JoinedModel* model)
      : options_(options),
        rigs_(rigs),
        center_priors_(center_priors),
        model_(model),
        index_in_block_(model->image_ids.size(), kNotInBlock) {
    solver_.label = "Block adjustment";
    solver_.max_num_iterations = options.bundle_adjustment.max_num_iterations;
    solver_.function_tolerance = options.bundle_adjustment.function_tolerance;
    solver_.num_threads = EffectiveNumThreads(num_threads);
    for (const colmap::image_t image_id : model->image_ids) {
      poses_.push_back(CamFromWorld(model->poses.Image(image_id)));
    }
    IndexPoints();
  }

  // Adjusts images, given by indices, and the points that they see. False if
  // the solver fails.
  bool Adjust(const RobustLoss& loss, const std::vector<uint32_t>& block) {
    Bundle bundle;
    const std::vector<uint32_t> images = AddBlock(block, &bundle);
    const std::vector<uint32_t> points = AddPoints(images, &bundle);
    const bool is_adjusted =
        points.empty() || Solve(loss, images, points, &bundle);
    for (const uint32_t image : touched_) index_in_block_[image] = kNotInBlock;
    touched_.clear();
    return is_adjusted;
  }

  // Reprojection error of each observation [px]; infinite behind the camera.
  std::vector<double> Errors() const {
    std::vector<double> errors;
    errors.reserve(model_->observations.size());
    for (size_t point = 0; point < model_->NumPoints(); ++point) {
      for (size_t i = model_->begins[point]; i < model_->begins[point + 1];
           ++i) {
        errors.push_back(Error(model_->points[point], model_->observations[i]));
      }
    }
    return errors;
  }

  // Leaves out observations with larger errors.
  size_t Filter(double max_error_px) {
    const std::vector<double> errors = Errors();
    std::vector<bool> keep;
    for (const double error : errors) keep.push_back(error <= max_error_px);
    const size_t num_before = model_->observations.size();
    model_->Keep(keep);
    IndexPoints();
    return num_before - model_->observations.size();
  }

  void WriteBack() {
    for (size_t i = 0; i < poses_.size(); ++i) {
      SetCamFromWorld(poses_[i], &model_->poses.Image(model_->image_ids[i]));
    }
  }

 private:
  // The points that each image sees.
  void IndexPoints() {
    begins_.assign(model_->image_ids.size() + 1, 0);
    for (const JoinedModel::Observation& observation : model_->observations) {
      ++begins_[observation.image + 1];
    }
    for (size_t i = 1; i < begins_.size(); ++i) begins_[i] += begins_[i - 1];
    point_of_.resize(model_->observations.size());
    std::vector<size_t> ends(begins_.begin(), begins_.end() - 1);
    for (size_t point = 0; point < model_->NumPoints(); ++point) {
      for (size_t i = model_->begins[point]; i < model_->begins[point + 1];
           ++i) {
        point_of_[ends[model_->observations[i].image]++] = uint32_t(point);
      }
    }
  }

  const colmap::Camera& CameraOf(uint32_t image) const {
    return model_->poses.Camera(
        model_->poses.Image(model_->image_ids[image]).CameraId());
  }

  double Error(const Eigen::Vector3d& xyz,
               const JoinedModel::Observation& observation) const {
    const colmap::Camera& camera = CameraOf(observation.image);
    const Eigen::Vector3d in_cam = poses_[observation.image] * xyz;
    Eigen::Vector2d xy_px;
    if (!(in_cam.z() > 0) ||
        !ProjectionOfModel(camera.ModelId())(
            camera.ParamsData(), in_cam, &xy_px, nullptr)) {
      return std::numeric_limits<double>::infinity();
    }
    return (xy_px - observation.xy_px.cast<double>()).norm();
  }

  void AddImage(uint32_t image, bool is_held, Bundle* bundle) {
    index_in_block_[image] = int(bundle->images.size());
    touched_.push_back(image);
    const colmap::camera_t camera_id =
        model_->poses.Image(model_->image_ids[image]).CameraId();
    const auto [camera, is_new] =
        cameras_.emplace(camera_id, int(bundle->cameras.size()));
    if (is_new) {
      const colmap::Camera& added = model_->poses.Camera(camera_id);
      bundle->cameras.push_back({added.ModelId(), added.Params(), {}});
    }
    BundleImage& added = bundle->images.emplace_back();
    added.cam_from_world = poses_[image];
    added.camera = camera->second;
    added.is_constant.fill(is_held);
  }

  // The images of a block that see points.
  std::vector<uint32_t> AddBlock(const std::vector<uint32_t>& block,
                                 Bundle* bundle) {
    cameras_.clear();
    std::map<colmap::camera_t, int> sensors;
    std::map<frame_t, int> frames;
    std::vector<uint32_t> images;
    for (const uint32_t image : block) {
      if (begins_[image] == begins_[image + 1]) continue;
      images.push_back(image);
      AddImage(image, /*is_held=*/false, bundle);
      const auto member = rigs_.frames.find(model_->image_ids[image]);
      if (member == rigs_.frames.end()) continue;
      const Rigid3d& cam_from_rig = member->second.cam_from_rig;
      const auto [sensor, is_new_sensor] = sensors.emplace(
          member->second.camera_id, int(bundle->sensors.size()));
      if (is_new_sensor) bundle->sensors.push_back({cam_from_rig, false});
      const auto [frame, is_new_frame] =
          frames.emplace(member->second.frame_id, int(bundle->frames.size()));
      if (is_new_frame) {
        bundle->frames.push_back({cam_from_rig.Inverse() * poses_[image], {}});
      }
      bundle->images.back().sensor = sensor->second;
      bundle->images.back().frame = frame->second;
    }
    return images;
  }

  // The points that the images see, with all images that see them.
  std::vector<uint32_t> AddPoints(const std::vector<uint32_t>& images,
                                  Bundle* bundle) {
    std::vector<uint32_t> points;
    for (const uint32_t image : images) {
      points.insert(points.end(),
                    point_of_.begin() + begins_[image],
                    point_of_.begin() + begins_[image + 1]);
    }
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
    for (const uint32_t point : points) {
      for (size_t i = model_->begins[point]; i < model_->begins[point + 1];
           ++i) {
        const JoinedModel::Observation& observation = model_->observations[i];
        if (index_in_block_[observation.image] == kNotInBlock) {
          AddImage(observation.image, /*is_held=*/true, bundle);
        }
        bundle->observations.push_back({index_in_block_[observation.image],
                                        int(bundle->points.size()),
                                        observation.xy_px.cast<double>()});
      }
      bundle->points.push_back(model_->points[point]);
    }
    return points;
  }

  void AddCenterPriors(size_t num_free, Bundle* bundle) const {
    bundle->center_priors.resize(bundle->images.size());
    for (size_t i = 0; i < num_free; ++i) {
      const auto prior =
          center_priors_.centers.find(model_->image_ids[touched_[i]]);
      if (prior != center_priors_.centers.end()) {
        bundle->center_priors[i] = prior->second;
      }
    }
    bundle->center_prior_weight = {
        options_.bundle_adjustment.intrinsics.keypoint_stddev_px,
        center_priors_.loss_scale};
  }

  // Holds a pose, and of the image farthest from it the coordinate that a
  // change of scale about the first moves most.
  void FixGauge(Bundle* bundle) const {
    const auto parts_of = [&](BundleImage* image) {
      return image->frame < 0 ? &image->is_constant
                              : &bundle->frames[image->frame].is_constant;
    };
    BundleImage& first = bundle->images.front();
    const Eigen::Vector3d center = first.cam_from_world.TargetOriginInSource();
    parts_of(&first)->fill(true);
    if (rigs_.fix_scale) return;
    BundleImage& farthest = *std::max_element(
        bundle->images.begin(),
        bundle->images.end(),
        [&](const BundleImage& a, const BundleImage& b) {
          const auto distance = [&](const BundleImage& image) {
            return (image.cam_from_world.TargetOriginInSource() - center)
                .norm();
          };
          return distance(a) < distance(b);
        });
    const Rigid3d& pose = farthest.frame < 0
                              ? farthest.cam_from_world
                              : bundle->frames[farthest.frame].rig_from_world;
    int coordinate = 0;
    (pose * center).cwiseAbs().maxCoeff(&coordinate);
    (*parts_of(&farthest))[3 + coordinate] = true;
  }

  bool Solve(const RobustLoss& loss,
             const std::vector<uint32_t>& images,
             const std::vector<uint32_t>& points,
             Bundle* bundle) {
    if (!center_priors_.centers.empty()) {
      AddCenterPriors(images.size(), bundle);
    } else if (bundle->images.size() == images.size()) {
      FixGauge(bundle);
    }
    if (!SolveBundle(solver_, loss, bundle).success) return false;
    for (size_t i = 0; i < images.size(); ++i) {
      poses_[images[i]] = bundle->images[i].cam_from_world;
    }
    for (size_t i = 0; i < points.size(); ++i) {
      model_->points[points[i]] = bundle->points[i];
    }
    return true;
  }

  const BlockAdjustmentOptions& options_;
  const RigConstraints& rigs_;
  const CenterPriors& center_priors_;
  JoinedModel* model_;
  PointMinimizerOptions solver_;
  std::vector<Rigid3d> poses_;
  // Image i sees point_of_[begins_[i]] to point_of_[begins_[i + 1] - 1].
  std::vector<size_t> begins_;
  std::vector<uint32_t> point_of_;
  // The present block.
  std::vector<int> index_in_block_;
  std::vector<uint32_t> touched_;
  std::map<colmap::camera_t, int> cameras_;
};

RobustLoss LossOf(const BlockAdjustmentOptions& options,
                  const JoinedModel& model,
                  const std::vector<double>& errors) {
  if (!options.adapt_loss) return options.bundle_adjustment.Loss();
  ReprojectionErrors finite;
  for (size_t point = 0; point < model.NumPoints(); ++point) {
    const size_t end = model.begins[point + 1];
    for (size_t i = model.begins[point]; i < end; ++i) {
      if (std::isfinite(errors[i])) {
        finite.Add(errors[i], end - model.begins[point]);
      }
    }
  }
  const LossScales scales =
      AdaptedLossScales(options.bundle_adjustment, finite);
  BundleAdjustmentOptions adapted = options.bundle_adjustment;
  adapted.loss_scale_px = scales.soft_l1_px;
  adapted.cauchy_scale_px = scales.cauchy_px;
  return adapted.Loss();
}

// Sum of the robust costs; an observation behind its camera counts as one at
// the bound of the filter.
double CostOf(const RobustLoss& loss,
              double max_error_px,
              const std::vector<double>& errors) {
  double cost = 0;
  for (const double error : errors) {
    const double bounded = std::isfinite(error) ? error : max_error_px;
    cost += loss.Cost(bounded * bounded);
  }
  return cost;
}

void SetPointErrors(const std::vector<double>& errors, JoinedModel* model) {
  for (size_t point = 0; point < model->NumPoints(); ++point) {
    const size_t begin = model->begins[point];
    const size_t end = model->begins[point + 1];
    double sum = 0;
    for (size_t i = begin; i < end; ++i) sum += errors[i];
    model->point_errors_px.push_back(sum / double(end - begin));
  }
}

}  // namespace

bool BlockAdjustmentOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("max_num_sweeps", max_num_sweeps, 0)
      .AtLeast("min_cost_decrease", min_cost_decrease, 0)
      .Above("max_reprojection_error", max_reprojection_error_px, 0)
      .Valid(bundle_adjustment)
      .AreKept();
}

std::optional<BlockAdjustmentSummary> AdjustBlocks(
    const BlockAdjustmentOptions& options,
    int num_threads,
    const RigConstraints& rigs,
    const CenterPriors& center_priors,
    JoinedModel* model) {
  BlockAdjuster adjuster(options, num_threads, rigs, center_priors, model);
  std::vector<double> errors = adjuster.Errors();
  const RobustLoss loss = LossOf(options, *model, errors);
  const double max_error_px = options.max_reprojection_error_px;
  const auto robust_rms = [&] {
    return std::sqrt(2 * CostOf(loss, max_error_px, errors) /
                     double(std::max<size_t>(errors.size(), 1)));
  };
  BlockAdjustmentSummary summary;
  summary.initial_robust_rms_px = robust_rms();
  summary.final_robust_rms_px = summary.initial_robust_rms_px;
  while (!summary.converged && summary.num_sweeps < options.max_num_sweeps) {
    for (const std::vector<uint32_t>& block : model->blocks) {
      if (!adjuster.Adjust(loss, block)) return std::nullopt;
    }
    const double before = summary.final_robust_rms_px;
    if (summary.num_sweeps++ == 0) {
      summary.num_filtered = adjuster.Filter(max_error_px);
    }
    errors = adjuster.Errors();
    summary.final_robust_rms_px = robust_rms();
    VLOG(1) << "Sweep " << summary.num_sweeps << ": robust RMS "
            << summary.final_robust_rms_px << " px";
    const double ratio = summary.final_robust_rms_px / before;
    // The first also changes what is counted.
    summary.converged =
        summary.num_sweeps > 1 && 1 - ratio * ratio < options.min_cost_decrease;
  }
  SetPointErrors(errors, model);
  adjuster.WriteBack();
  return summary;
}

}  // namespace dgsfm
