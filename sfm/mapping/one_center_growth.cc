#include "sfm/mapping/one_center_growth.h"

#include "colmap_ext/model/registered_images.h"
#include "colmap_ext/pose_access.h"
#include "colmap_ext/scene.h"
#include "estimators/median.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include <Eigen/SVD>
#include <glog/logging.h>

namespace dgsfm {

namespace {

// Share of the first image's tracks that images must see to start with it, ...
constexpr double kMinSeedShare = 0.4;
// ... and how many do.
constexpr size_t kMinNumSeedImages = 3;
constexpr size_t kMaxNumSeedImages = 9;
// Share of an image's tracks that must be placed before it follows.
constexpr double kMinPlacedShare = 0.5;
// Fewer placed tracks do not hold a pose.
constexpr size_t kMinNumPlacedTracks = 15;
// Bounds of distances of points in a reversed model [median distance].
constexpr double kMaxReversedRatio = 5;

class Growth {
 public:
  Growth(const colmap::Reconstruction& turned, const GrowthAdjuster& adjust)
      : turned_(turned), adjust_(adjust) {
    for (const auto& [camera_id, camera] : turned.Cameras()) {
      cameras_[camera_id] = camera;
    }
    for (const colmap::point3D_t point_id : SortedPoints(turned)) {
      for (const colmap::TrackElement& element :
           turned.Point3D(point_id).Track().Elements()) {
        points_of_images_[element.image_id].insert(point_id);
      }
    }
  }

  colmap::Reconstruction Run() {
    if (!PlaceSeed()) return colmap::Reconstruction();
    while (true) {
      const std::vector<colmap::image_t> next = NextImages();
      if (next.empty()) break;
      for (const colmap::image_t image_id : next) PlaceByNeighbor(image_id);
      // Points that only new images see would hold them where they start.
      if (Adjust() < 0) return colmap::Reconstruction();
      PlaceNewPoints();
    }
    if (Adjust() < 0) return colmap::Reconstruction();
    return Build();
  }

 private:
  size_t NumShared(colmap::image_t image_id1, colmap::image_t image_id2) const {
    const std::set<colmap::point3D_t>& points1 =
        points_of_images_.at(image_id1);
    return size_t(std::count_if(
        points1.begin(), points1.end(), [&](colmap::point3D_t id) {
          return points_of_images_.at(image_id2).count(id) > 0;
        }));
  }

  std::vector<colmap::image_t> SeedImages() const {
    const auto anchor =
        std::max_element(points_of_images_.begin(),
                         points_of_images_.end(),
                         [](const auto& a, const auto& b) {
                           return a.second.size() < b.second.size();
                         });
    if (anchor == points_of_images_.end()) return {};
    std::vector<std::pair<size_t, colmap::image_t>> others;
    for (const auto& [image_id, points] : points_of_images_) {
      if (image_id == anchor->first) continue;
      others.emplace_back(NumShared(anchor->first, image_id), image_id);
    }
    std::stable_sort(
        others.begin(), others.end(), [](const auto& a, const auto& b) {
          return a.first > b.first;
        });
    std::vector<colmap::image_t> image_ids = {anchor->first};
    for (const auto& [num_shared, image_id] : others) {
      const bool sees_enough =
          double(num_shared) >= kMinSeedShare * double(anchor->second.size());
      if (num_shared < kMinNumPlacedTracks ||
          image_ids.size() >= kMaxNumSeedImages ||
          (image_ids.size() >= kMinNumSeedImages && !sees_enough)) {
        break;
      }
      image_ids.push_back(image_id);
    }
    return image_ids;
  }

  bool PlaceSeed() {
    const std::vector<colmap::image_t> image_ids = SeedImages();
    if (image_ids.size() < 2) return false;
    for (const colmap::image_t image_id : image_ids) {
      poses_[image_id] = CamFromWorld(turned_.Image(image_id));
    }
    PlaceNewPoints();
    const double cost = Adjust();
    if (cost < 0) return false;
    Growth reversed = *this;
    reversed.Reverse();
    const double reversed_cost = reversed.Adjust();
    VLOG(1) << image_ids.size() << " images from one centre cost " << cost
            << ", reversed " << reversed_cost;
    if (reversed_cost >= 0 && reversed_cost < cost) {
      poses_ = std::move(reversed.poses_);
      points_ = std::move(reversed.points_);
      cameras_ = std::move(reversed.cameras_);
    }
    return true;
  }

  // Centres move to the other side of their mean, and points from before to
  // behind their median distance by as much parallax.
  void Reverse() {
    const Eigen::Vector3d center = MeanCenter();
    const double median = MedianDistance(center);
    for (auto& [image_id, pose] : poses_) {
      const Eigen::Vector3d reversed = 2 * center - pose.TargetOriginInSource();
      pose.translation = -(pose.rotation * reversed);
    }
    for (auto& [point_id, xyz] : points_) {
      const double ratio = (xyz - center).norm() / median;
      const double reversed_ratio =
          1 / std::clamp(2 - 1 / ratio, 1 / kMaxReversedRatio, 2.0);
      xyz = center + reversed_ratio * median * (xyz - center).normalized();
    }
    for (auto& [image_id, pose] : poses_) TurnToPoints(image_id, &pose);
  }

  // Turns an image to where its centre sees its points.
  void TurnToPoints(colmap::image_t image_id, Rigid3d* pose) const {
    const Eigen::Vector3d center = pose->TargetOriginInSource();
    Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
    for (const colmap::point3D_t point_id : points_of_images_.at(image_id)) {
      const auto point = points_.find(point_id);
      if (point == points_.end()) continue;
      for (const colmap::TrackElement& element :
           turned_.Point3D(point_id).Track().Elements()) {
        if (element.image_id != image_id) continue;
        correlation += RayInCamera(element) *
                       (point->second - center).normalized().transpose();
      }
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(
        correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d U = svd.matrixU();
    if ((U * svd.matrixV().transpose()).determinant() < 0) U.col(2) *= -1;
    pose->rotation =
        Eigen::Quaterniond(Eigen::Matrix3d(U * svd.matrixV().transpose()));
    pose->translation = -(pose->rotation * center);
  }

  // As RayInCam(), by the cameras as adjusted so far.
  Eigen::Vector3d RayInCamera(const colmap::TrackElement& element) const {
    const colmap::Image& image = turned_.Image(element.image_id);
    return cameras_.at(image.CameraId())
        .ImageToWorld(image.Point2D(element.point2D_idx).XY())
        .homogeneous()
        .normalized();
  }

  // Median distance of the points from a centre; 1 without any.
  double MedianDistance(const Eigen::Vector3d& center) const {
    std::vector<double> distances;
    for (const auto& [point_id, xyz] : points_) {
      distances.push_back((xyz - center).norm());
    }
    return distances.empty() ? 1 : Median(std::move(distances));
  }

  Eigen::Vector3d MeanCenter() const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const auto& [image_id, pose] : poses_) {
      sum += pose.TargetOriginInSource();
    }
    return sum / double(poses_.size());
  }

  // Images most of whose tracks are placed, or the one with the largest share.
  std::vector<colmap::image_t> NextImages() const {
    std::vector<colmap::image_t> next;
    colmap::image_t best = colmap::kInvalidImageId;
    double best_share = 0;
    for (const auto& [image_id, point_ids] : points_of_images_) {
      if (poses_.count(image_id) > 0) continue;
      const auto num_placed = size_t(std::count_if(
          point_ids.begin(), point_ids.end(), [&](colmap::point3D_t id) {
            return points_.count(id) > 0;
          }));
      if (num_placed < kMinNumPlacedTracks) continue;
      const double share = double(num_placed) / double(point_ids.size());
      if (share >= kMinPlacedShare) next.push_back(image_id);
      if (share > best_share) {
        best_share = share;
        best = image_id;
      }
    }
    if (next.empty() && best != colmap::kInvalidImageId) next.push_back(best);
    return next;
  }

  void PlaceByNeighbor(colmap::image_t image_id) {
    colmap::image_t neighbor = colmap::kInvalidImageId;
    size_t max_num_shared = 0;
    for (const auto& [placed_id, pose] : poses_) {
      const size_t num_shared = NumShared(image_id, placed_id);
      if (neighbor == colmap::kInvalidImageId || num_shared > max_num_shared) {
        neighbor = placed_id;
        max_num_shared = num_shared;
      }
    }
    const Rigid3d& pose = poses_.at(neighbor);
    Rigid3d placed;
    placed.rotation =
        (CamFromWorld(turned_.Image(image_id)).rotation *
         CamFromWorld(turned_.Image(neighbor)).rotation.conjugate() *
         pose.rotation)
            .normalized();
    placed.translation = -(placed.rotation * pose.TargetOriginInSource());
    new_poses_[image_id] = placed;
  }

  // At the median distance of the others, where two placed images see them.
  void PlaceNewPoints() {
    const Eigen::Vector3d center = MeanCenter();
    const double distance = MedianDistance(center);
    for (const colmap::point3D_t point_id : SortedPoints(turned_)) {
      if (points_.count(point_id) > 0) continue;
      Eigen::Vector3d ray = Eigen::Vector3d::Zero();
      Eigen::Vector3d origin = Eigen::Vector3d::Zero();
      int count = 0;
      for (const colmap::TrackElement& element :
           turned_.Point3D(point_id).Track().Elements()) {
        const auto pose = poses_.find(element.image_id);
        if (pose == poses_.end()) continue;
        ray += pose->second.rotation.conjugate() * RayInCamera(element);
        origin += pose->second.TargetOriginInSource();
        ++count;
      }
      if (count < 2 || !(ray.norm() > 0)) continue;
      points_[point_id] = origin / count + distance * ray.normalized();
    }
  }

  // The placed part as a model; point ids are those of its order.
  colmap::Reconstruction Build() const {
    colmap::Reconstruction model;
    // All of them: groups of cameras have one mean.
    for (const auto& [camera_id, camera] : cameras_) {
      model.AddCamera(camera);
    }
    for (const auto& [image_id, pose] : poses_) {
      const colmap::Image& source = turned_.Image(image_id);
      colmap::Image image;
      image.SetImageId(image_id);
      image.SetName(source.Name());
      image.SetCameraId(source.CameraId());
      std::vector<Eigen::Vector2d> xys;
      for (const colmap::Point2D& point2D : source.Points2D()) {
        xys.push_back(point2D.XY());
      }
      image.SetPoints2D(xys);
      SetCamFromWorld(pose, &image);
      model.AddImage(image);
      model.RegisterImage(image_id);
    }
    for (const auto& [point_id, xyz] : points_) {
      colmap::Track track;
      for (const colmap::TrackElement& element :
           turned_.Point3D(point_id).Track().Elements()) {
        if (poses_.count(element.image_id) > 0) track.AddElement(element);
      }
      model.AddPoint3D(xyz, track);
    }
    return model;
  }

  double Adjust() {
    poses_.merge(new_poses_);
    new_poses_.clear();
    colmap::Reconstruction model = Build();
    const double cost = adjust_(&model);
    if (cost < 0) return cost;
    for (auto& [image_id, pose] : poses_) {
      pose = CamFromWorld(model.Image(image_id));
    }
    // Points keep the order that they were added in.
    const std::vector<colmap::point3D_t> point_ids = SortedPoints(model);
    size_t i = 0;
    for (auto& [point_id, xyz] : points_) {
      xyz = model.Point3D(point_ids[i++]).XYZ();
    }
    for (const auto& [camera_id, camera] : model.Cameras()) {
      cameras_.at(camera_id).SetParams(camera.Params());
    }
    return cost;
  }

  const colmap::Reconstruction& turned_;
  const GrowthAdjuster& adjust_;
  std::map<colmap::image_t, std::set<colmap::point3D_t>> points_of_images_;
  // As adjusted so far.
  CameraMap cameras_;
  std::map<colmap::image_t, Rigid3d> poses_;
  std::map<colmap::image_t, Rigid3d> new_poses_;
  std::map<colmap::point3D_t, Eigen::Vector3d> points_;
};

}  // namespace

colmap::Reconstruction GrowFromOneCenter(const colmap::Reconstruction& turned,
                                         const GrowthAdjuster& adjust) {
  return Growth(turned, adjust).Run();
}

}  // namespace dgsfm
