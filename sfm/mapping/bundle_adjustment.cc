#include "sfm/mapping/bundle_adjustment.h"

#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "estimators/median.h"
#include "estimators/optimization/bundle_solver.h"
#include "estimators/option_check.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Observations below which the images of a camera cannot carry its intrinsics.
constexpr size_t kMinNumObservationsPerCamera = 50;
// Observations below which threads cost more than they give.
constexpr size_t kMinNumObservationsForThreads = 10000;

// Images from which on models are adjusted as those that drift are: by curved
// steps that are hardly damped, less and less so. Models of few images come out
// worse: what they leave open goes further than it should.
constexpr size_t kMinNumImagesWithDrift = 100;
constexpr double kInitialDampingWithDrift = 1e-9;
constexpr double kDampingRatioWithDrift = 0.1;

// Loss scale that fits key points [median error], ...
constexpr double kLossScalePerError = 1.5;
// ... at least, of the largest one: the errors of exact key points are
// rounding.
constexpr double kMinLossScaleRatio = 0.1;
// Tails are judged by the error that this share of all errors does not exceed.
constexpr double kTailShare = 0.9;
// A Cauchy loss replaces the soft L1 loss where that error is larger than this
// [median error]. In the plane it is 3.0 for Student's t distribution with two
// degrees of freedom, whose variance is infinite.
constexpr double kHeavyTailRatio = 3.1;
// Tails are judged by points that so many images see: a point of two images
// follows three of its four coordinates, and leaves one error.
constexpr size_t kMinNumViewsOfTail = 3;

// The arrays of a model, and back.
class ModelBundle {
 public:
  ModelBundle(const BundleAdjustmentOptions& options,
              const CameraBeliefs& beliefs,
              const RigConstraints& rigs,
              colmap::Reconstruction* model)
      : options_(options),
        beliefs_(beliefs),
        rigs_(rigs),
        model_(model),
        point_ids_(SortedPoints(*model)) {
    for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
      AddImage(image_id);
    }
    AddPoints();
    for (size_t i = 0; i < camera_ids_.size(); ++i) {
      RefineCamera(num_observations_[i], i);
    }
  }

  // Holds the pose of an image, and of the image farthest from it the
  // coordinate that a change of scale about the first moves most.
  void FixGauge(colmap::image_t fixed_image) {
    const Eigen::Vector3d center =
        CamFromWorld(model_->Image(fixed_image)).TargetOriginInSource();
    BundleImage* farthest = nullptr;
    double max_distance = 0;
    for (size_t i = 0; i < image_ids_.size(); ++i) {
      BundleImage& image = bundle_.images[i];
      if (image_ids_[i] == fixed_image) ConstantPartsOf(&image).fill(true);
      const double distance =
          (image.cam_from_world.TargetOriginInSource() - center).norm();
      if (distance > max_distance) {
        max_distance = distance;
        farthest = &image;
      }
    }
    if (!farthest || RigsHoldScale()) return;
    const Rigid3d& pose = farthest->frame < 0
                              ? farthest->cam_from_world
                              : bundle_.frames[farthest->frame].rig_from_world;
    int coordinate = 0;
    (pose * center).cwiseAbs().maxCoeff(&coordinate);
    ConstantPartsOf(farthest)[3 + coordinate] = true;
  }

  // Whether two images of a frame are at a distance that is not refined.
  bool RigsHoldScale() const {
    FrameMembers held;
    for (const auto& [image_id, member] : rigs_.frames) {
      if (rigs_.refined_cameras.count(member.camera_id) == 0) {
        held.emplace(image_id, member);
      }
    }
    return HasBaseline(held, image_ids_);
  }

  void AddCenterPriors(const CenterPriors& priors) {
    for (const colmap::image_t image_id : image_ids_) {
      const auto prior = priors.centers.find(image_id);
      bundle_.center_priors.push_back(
          prior == priors.centers.end() ? CenterPrior() : prior->second);
    }
    bundle_.center_prior_weight = {options_.intrinsics.keypoint_stddev_px,
                                   priors.loss_scale};
  }

  std::optional<double> Solve(int num_threads) {
    const size_t num_observations = bundle_.observations.size();
    if (num_observations == 0) return std::nullopt;
    PointMinimizerOptions options;
    options.label = "Bundle adjustment";
    options.max_num_iterations = options_.max_num_iterations;
    options.function_tolerance = options_.function_tolerance;
    if (MayDrift(*model_)) {
      options.initial_damping = kInitialDampingWithDrift;
      options.min_damping_ratio = kDampingRatioWithDrift;
      bundle_.curved_steps = true;
    }
    options.num_threads = num_observations < kMinNumObservationsForThreads
                              ? 1
                              : EffectiveNumThreads(num_threads);
    const PointMinimizerSummary summary =
        SolveBundle(options, options_.Loss(), &bundle_);
    if (!summary.success) return std::nullopt;
    VLOG(1) << "Bundle adjustment: " << summary.num_iterations
            << " iterations, cost " << summary.initial_cost << " to "
            << summary.final_cost;
    WriteBack();
    return std::sqrt(2 * summary.final_cost / double(num_observations));
  }

 private:
  // The held parts of the pose that an image moves by.
  std::array<bool, 6>& ConstantPartsOf(BundleImage* image) {
    return image->frame < 0 ? image->is_constant
                            : bundle_.frames[image->frame].is_constant;
  }

  void AddImage(colmap::image_t image_id) {
    const colmap::Image& image = model_->Image(image_id);
    if (image.NumPoints3D() == 0) return;
    const int camera_index = IndexOfCamera(image.CameraId());
    num_observations_[camera_index] += image.NumPoints3D();
    image_ids_.push_back(image_id);
    BundleImage& bundle_image = bundle_.images.emplace_back();
    bundle_image.cam_from_world = CamFromWorld(image);
    bundle_image.camera = camera_index;
    if (rigs_.at_one_center) {
      std::fill_n(bundle_image.is_constant.begin() + 3, 3, true);
    }
    const auto member = rigs_.frames.find(image_id);
    if (member != rigs_.frames.end()) JoinFrame(member->second, &bundle_image);
  }

  // Their observations by image, as the solver wants them.
  void AddPoints() {
    bundle_.points.reserve(point_ids_.size());
    bundle_.observations.reserve(model_->ComputeNumObservations());
    for (const colmap::point3D_t point_id : point_ids_) {
      const colmap::Point3D& point = model_->Point3D(point_id);
      std::vector<colmap::TrackElement> elements = point.Track().Elements();
      std::sort(
          elements.begin(), elements.end(), [](const auto& a, const auto& b) {
            return std::tie(a.image_id, a.point2D_idx) <
                   std::tie(b.image_id, b.point2D_idx);
          });
      for (const auto& [image_id, point2D_idx] : elements) {
        const auto image =
            std::lower_bound(image_ids_.begin(), image_ids_.end(), image_id);
        bundle_.observations.push_back(
            {int(image - image_ids_.begin()),
             int(bundle_.points.size()),
             model_->Image(image_id).Point2D(point2D_idx).XY()});
      }
      bundle_.points.push_back(point.XYZ());
    }
  }

  void JoinFrame(const FrameMember& member, BundleImage* image) {
    const auto [sensor, is_new_sensor] =
        sensors_.emplace(member.camera_id, int(bundle_.sensors.size()));
    if (is_new_sensor) {
      bundle_.sensors.push_back(
          {member.cam_from_rig,
           rigs_.refined_cameras.count(member.camera_id) > 0});
    }
    const auto [frame, is_new_frame] =
        frames_.emplace(member.frame_id, int(bundle_.frames.size()));
    if (is_new_frame) {
      bundle_.frames.push_back(
          {member.cam_from_rig.Inverse() * image->cam_from_world, {}});
    }
    image->sensor = sensor->second;
    image->frame = frame->second;
  }

  // Cameras of a group have one index.
  int IndexOfCamera(colmap::camera_t camera_id) {
    const auto [it, is_new] =
        camera_indices_.emplace(camera_id, int(bundle_.cameras.size()));
    if (!is_new) return it->second;
    const colmap::Camera& camera = model_->Camera(camera_id);
    BundleCamera bundle_camera = {camera.ModelId(), camera.Params(), {}};
    if (const CameraGroup* group = beliefs_.GroupOf(camera_id)) {
      // Cameras of a group may start apart, by what the database has for each.
      bundle_camera.params = MeanParams(*group, *model_);
      for (const colmap::camera_t member : group->camera_ids) {
        camera_indices_[member] = it->second;
      }
    }
    camera_ids_.push_back(camera_id);
    num_observations_.push_back(0);
    bundle_.cameras.push_back(bundle_camera);
    return it->second;
  }

  void RefineCamera(size_t num_observations, size_t index) {
    if (num_observations < kMinNumObservationsPerCamera) return;
    const colmap::camera_t camera_id = camera_ids_[index];
    const Eigen::VectorXd stddevs =
        PriorStddevs(options_.intrinsics, beliefs_, camera_id);
    BundleCamera& camera = bundle_.cameras[index];
    for (int i = 0; i < stddevs.size(); ++i) {
      if (stddevs(i) > 0) camera.refined_params.push_back(i);
    }
    if (camera.refined_params.empty()) return;
    const double unit_px = options_.intrinsics.keypoint_stddev_px;
    const Eigen::VectorXd mean = PriorMean(beliefs_, camera_id);
    for (const RobustPrior& prior :
         SplitPriors(options_.intrinsics, beliefs_, camera_id)) {
      BundlePrior& term = bundle_.priors.emplace_back();
      term.camera = int(index);
      term.loss_scale_px = prior.loss_scale * unit_px;
      for (const Eigen::Index i : prior.idxs) {
        term.parameters.push_back({int(i), mean(i), stddevs(i) / unit_px});
      }
    }
  }

  void WriteBack() {
    for (size_t i = 0; i < image_ids_.size(); ++i) {
      SetCamFromWorld(bundle_.images[i].cam_from_world,
                      &model_->Image(image_ids_[i]));
    }
    WriteBackFrames();
    for (const auto& [camera_id, index] : camera_indices_) {
      if (!model_->ExistsCamera(camera_id)) continue;
      model_->Camera(camera_id).SetParams(bundle_.cameras[index].params);
    }
    for (size_t i = 0; i < point_ids_.size(); ++i) {
      model_->Point3D(point_ids_[i]).SetXYZ(bundle_.points[i]);
    }
  }

  // Images of frames that see no point move with the others, too.
  void WriteBackFrames() {
    for (const auto& [image_id, member] : rigs_.frames) {
      const auto frame = frames_.find(member.frame_id);
      const auto sensor = sensors_.find(member.camera_id);
      if (frame == frames_.end() || !model_->ExistsImage(image_id)) continue;
      const Rigid3d& cam_from_rig =
          sensor == sensors_.end()
              ? member.cam_from_rig
              : bundle_.sensors[sensor->second].cam_from_rig;
      SetCamFromWorld(
          cam_from_rig * bundle_.frames[frame->second].rig_from_world,
          &model_->Image(image_id));
    }
  }

  const BundleAdjustmentOptions& options_;
  const CameraBeliefs& beliefs_;
  const RigConstraints& rigs_;
  colmap::Reconstruction* model_;
  // By their index in the bundle, in increasing order.
  std::vector<colmap::image_t> image_ids_;
  std::vector<colmap::camera_t> camera_ids_;
  const std::vector<colmap::point3D_t> point_ids_;
  std::map<colmap::camera_t, int> camera_indices_;
  std::vector<size_t> num_observations_;
  // Indices in the bundle.
  std::map<frame_t, int> frames_;
  std::map<colmap::camera_t, int> sensors_;
  Bundle bundle_;
};

ReprojectionErrors CollectErrors(const colmap::Reconstruction& model) {
  ReprojectionErrors errors;
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    const colmap::Point3D& point = model.Point3D(point_id);
    for (const colmap::TrackElement& element : point.Track().Elements()) {
      const Eigen::Vector3d in_cam =
          CamFromWorld(model.Image(element.image_id)) * point.XYZ();
      if (!(in_cam.z() > 0)) continue;
      errors.Add(ReprojectionError(model, element, in_cam),
                 point.Track().Length());
    }
  }
  return errors;
}

}  // namespace

bool MayDrift(const colmap::Reconstruction& model) {
  return model.NumRegImages() >= kMinNumImagesWithDrift;
}

RobustLoss BundleAdjustmentOptions::Loss() const {
  if (cauchy_scale_px) return {RobustLoss::Type::CAUCHY, *cauchy_scale_px};
  return {RobustLoss::Type::SOFT_L1, loss_scale_px};
}

bool BundleAdjustmentOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("max_num_iterations", max_num_iterations, 1)
      .AtLeast("function_tolerance", function_tolerance, 0)
      .Above("ba_loss_scale", loss_scale_px, 0)
      .Above("cauchy_scale_px", cauchy_scale_px.value_or(1), 0)
      .Valid(intrinsics)
      .AreKept();
}

void ReprojectionErrors::Add(double error_px, size_t num_views) {
  all_px.push_back(error_px);
  if (num_views >= kMinNumViewsOfTail) of_tails_px.push_back(error_px);
}

LossScales AdaptedLossScales(const BundleAdjustmentOptions& options,
                             const colmap::Reconstruction& model) {
  return AdaptedLossScales(options, CollectErrors(model));
}

LossScales AdaptedLossScales(const BundleAdjustmentOptions& options,
                             const ReprojectionErrors& errors) {
  if (errors.all_px.empty()) return {options.loss_scale_px, std::nullopt};
  const double min_scale_px = kMinLossScaleRatio * options.loss_scale_px;
  LossScales scales;
  scales.soft_l1_px = std::clamp(kLossScalePerError * Median(errors.all_px),
                                 min_scale_px,
                                 options.loss_scale_px);
  if (2 * errors.of_tails_px.size() < errors.all_px.size()) return scales;
  const double median_px = Median(errors.of_tails_px);
  const double tail_px = Quantile(errors.of_tails_px, kTailShare);
  VLOG(1) << "Reprojection errors: median " << median_px << " px, 90 % below "
          << tail_px << " px";
  if (tail_px > kHeavyTailRatio * median_px) {
    scales.cauchy_px = std::max(median_px, min_scale_px);
  }
  return scales;
}

std::optional<double> AdjustBundle(const BundleAdjustmentOptions& options,
                                   int num_threads,
                                   colmap::image_t fixed_image,
                                   const CameraBeliefs& beliefs,
                                   colmap::Reconstruction* model,
                                   const RigConstraints& rigs,
                                   const CenterPriors& center_priors) {
  if (model->NumPoints3D() == 0) return std::nullopt;
  ModelBundle bundle(options, beliefs, rigs, model);
  if (center_priors.centers.empty()) {
    bundle.FixGauge(fixed_image);
  } else {
    bundle.AddCenterPriors(center_priors);
  }
  return bundle.Solve(num_threads);
}

}  // namespace dgsfm
