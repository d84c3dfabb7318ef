#include "estimators/optimization/bundle_bodies.h"

#include "estimators/rotation_vector.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dgsfm {

namespace {

// MovePose about the centre to first order.
BodyMotion MotionOf(const PoseStep& step, const Rigid3d& pose) {
  const Eigen::Quaterniond world_from_body = pose.rotation.conjugate();
  return {pose.TargetOriginInSource(),
          world_from_body * -step.head<3>(),
          world_from_body * -step.tail<3>()};
}

}  // namespace

void MovePose(const PoseStep& step,
              const Eigen::Vector3d& pivot,
              Rigid3d* pose) {
  const Eigen::Quaterniond turn = RotationFromVector(step.head<3>());
  pose->rotation = (turn * pose->rotation).normalized();
  pose->translation =
      turn * (pose->translation - pivot) + pivot + step.tail<3>();
}

Eigen::Vector3d BodyPivot(const Bundle& bundle, const Rigid3d& pose) {
  return bundle.curved_steps ? Eigen::Vector3d(Eigen::Vector3d::Zero())
                             : pose.translation;
}

BundleBodies::BundleBodies(const ObservationIndex& observations, Bundle* bundle)
    : bundle_(bundle) {
  std::vector<int> body_of_image;
  for (size_t i = 0; i < bundle->images.size(); ++i) {
    const int frame = bundle->images[i].frame;
    body_of_image.push_back(frame < 0 ? int(Count()) : frame);
    if (frame < 0) free_images_.push_back(int(i));
  }
  if (bundle->curved_steps) PrepareCurvedStep(observations, body_of_image);
}

void BundleBodies::PrepareCurvedStep(const ObservationIndex& observations,
                                     const std::vector<int>& body_of_image) {
  int held_body = -1;
  for (int body = 0; body < int(Count()); ++body) {
    const std::array<bool, 6>& is_held = HeldComponentsOf(body);
    const auto num_held = std::count(is_held.begin(), is_held.end(), true);
    const auto first =
        std::find(is_held.begin(), is_held.end(), true) - is_held.begin();
    if (num_held == 6 && held_body < 0) {
      held_body = body;
    } else if (num_held == 1 && first >= 3 && !scale_gauge_) {
      scale_gauge_ = {body, int(first - 3)};
    } else if (num_held > 0) {
      return;
    }
  }
  if (held_body < 0) return;
  ObservationIndex by_body = observations;
  by_body.num_cameras = int(Count());
  for (int& camera : by_body.cameras) camera = body_of_image[camera];
  const PointRanges ranges(observations);
  for (int point = 0; point < observations.num_points; ++point) {
    std::sort(by_body.cameras.begin() + ranges.Begin(point),
              by_body.cameras.begin() + ranges.End(point));
  }
  curved_step_.emplace(std::move(by_body), held_body);
}

Rigid3d& BundleBodies::PoseOf(size_t body) const {
  return body < bundle_->frames.size() ? bundle_->frames[body].rig_from_world
                                       : FreeImage(body).cam_from_world;
}

const std::array<bool, 6>& BundleBodies::HeldComponentsOf(size_t body) const {
  return body < bundle_->frames.size() ? bundle_->frames[body].is_constant
                                       : FreeImage(body).is_constant;
}

void BundleBodies::Move(const std::vector<PoseStep>& steps,
                        const std::vector<Eigen::Vector3d>& point_steps,
                        int num_threads) {
  const std::optional<double> held_coordinate = ScaleCoordinate();
  std::vector<BodyMotion> motions;
  for (size_t body = 0; body < Count(); ++body) {
    Rigid3d& pose = PoseOf(body);
    if (curved_step_) motions.push_back(MotionOf(steps[body], pose));
    MovePose(steps[body], BodyPivot(*bundle_, pose), &pose);
  }
  std::optional<CurvedPositions> curved;
  if (curved_step_) {
    curved =
        curved_step_->Move(motions, bundle_->points, point_steps, num_threads);
  }
  if (curved && (!held_coordinate || HoldScale(*held_coordinate, &*curved))) {
    MoveTo(*curved);
    if (held_coordinate) {
      PoseOf(scale_gauge_->body).translation(scale_gauge_->index) =
          *held_coordinate;
    }
    return;
  }
  for (size_t i = 0; i < bundle_->points.size(); ++i) {
    bundle_->points[i] += point_steps[i];
  }
}

std::optional<double> BundleBodies::ScaleCoordinate() const {
  if (!scale_gauge_) return std::nullopt;
  return PoseOf(scale_gauge_->body).translation(scale_gauge_->index);
}

// Scales positions about the held body so that the coordinate of the gauge is
// what it was. False if no scale does that.
bool BundleBodies::HoldScale(double coordinate,
                             CurvedPositions* positions) const {
  const auto [body, index] = *scale_gauge_;
  const Eigen::Quaterniond& rotation = PoseOf(body).rotation;
  const Eigen::Vector3d held = positions->centers[curved_step_->HeldBody()];
  const Eigen::Vector3d offset_in_body =
      rotation * (held - positions->centers[body]);
  const double scale =
      (coordinate + (rotation * held)(index)) / offset_in_body(index);
  if (!(std::isfinite(scale) && scale > 0)) return false;
  for (auto* vectors : {&positions->centers, &positions->points}) {
    for (Eigen::Vector3d& vector : *vectors) {
      vector = held + scale * (vector - held);
    }
  }
  return true;
}

// The held body stays bit by bit.
void BundleBodies::MoveTo(const CurvedPositions& positions) {
  for (size_t body = 0; body < Count(); ++body) {
    if (int(body) == curved_step_->HeldBody()) continue;
    Rigid3d& pose = PoseOf(body);
    pose.translation = pose.rotation * -positions.centers[body];
  }
  bundle_->points = positions.points;
}

}  // namespace dgsfm
