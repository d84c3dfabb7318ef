#include "sfm/mapping/part_model.h"

#include "colmap_ext/pose_access.h"

#include <algorithm>
#include <map>
#include <utility>

namespace dgsfm {

namespace {

using PartImage = PartModel::PartImage;
using Observation = std::pair<colmap::image_t, colmap::point2D_t>;

// A point of several parts.
struct JoinedPoint {
  std::map<colmap::image_t, colmap::point2D_t> elements;
  // Its place in the part where most images see it.
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  size_t num_seeing = 0;
};

// Points of all parts; those that share an observation are one.
class PointJoiner {
 public:
  void Add(const PartModel& part, const Similarity3d& group_from_part) {
    std::map<colmap::point3D_t, std::vector<Observation>> tracks;
    for (const auto& [image_id, image] : part.images) {
      for (const auto& [point2D_idx, point_id] : image.points) {
        tracks[point_id].emplace_back(image_id, point2D_idx);
      }
    }
    for (const auto& [point_id, track] : tracks) {
      AddTrack(track, group_from_part * part.points.at(point_id));
    }
  }

  // By their first observations.
  std::vector<JoinedPoint> Points() const {
    std::map<Observation, const JoinedPoint*> sorted;
    for (const JoinedPoint& point : points_) {
      if (point.elements.size() >= 2) sorted[*point.elements.begin()] = &point;
    }
    std::vector<JoinedPoint> points;
    for (const auto& [first, point] : sorted) points.push_back(*point);
    return points;
  }

 private:
  void AddTrack(const std::vector<Observation>& track,
                const Eigen::Vector3d& xyz) {
    const size_t target = FindTarget(track);
    JoinedPoint& point = points_[target];
    for (const Observation& observation : track) {
      // An image sees a point once; what another point has stays with it.
      if (point_of_.emplace(observation, target).second) {
        if (!point.elements.insert(observation).second) {
          point_of_.erase(observation);
        }
      }
    }
    if (track.size() > point.num_seeing) {
      point.num_seeing = track.size();
      point.xyz = xyz;
    }
  }

  // The point that most observations have already, or a new one.
  size_t FindTarget(const std::vector<Observation>& track) {
    std::map<size_t, size_t> votes;
    for (const Observation& observation : track) {
      const auto found = point_of_.find(observation);
      if (found != point_of_.end()) ++votes[found->second];
    }
    if (votes.empty()) {
      points_.emplace_back();
      return points_.size() - 1;
    }
    return std::max_element(
               votes.begin(),
               votes.end(),
               [](const auto& a, const auto& b) { return a.second < b.second; })
        ->first;
  }

  std::vector<JoinedPoint> points_;
  std::map<Observation, size_t> point_of_;
};

// The camera parameters of each entry of the scene in the part that has most
// images of it.
CameraMap JoinCameras(const Scene& scene,
                      const std::vector<PartModel>& parts,
                      const PartGroup& group) {
  CameraMap cameras;
  std::map<colmap::camera_t, size_t> num_images;
  for (const int index : group.parts) {
    const PartModel& part = parts[index];
    std::map<std::pair<colmap::camera_t, colmap::camera_t>, size_t> counts;
    for (const auto& [image_id, image] : part.images) {
      ++counts[{scene.images.at(image_id).CameraId(), image.camera_id}];
    }
    for (const auto& [ids, count] : counts) {
      const auto [entry_id, camera_id] = ids;
      if (count <= num_images[entry_id]) continue;
      num_images[entry_id] = count;
      colmap::Camera camera = scene.cameras.at(entry_id);
      camera.SetModelId(part.cameras.at(camera_id).ModelId());
      camera.SetParams(part.cameras.at(camera_id).Params());
      cameras[entry_id] = camera;
    }
  }
  return cameras;
}

}  // namespace

colmap::Reconstruction JoinGroup(const Scene& scene,
                                 const std::vector<PartModel>& parts,
                                 const PartGroup& group) {
  // The part in which an image sees most points, as an index in the group.
  std::map<colmap::image_t, std::pair<size_t, size_t>> best;
  PointJoiner joiner;
  for (size_t i = 0; i < group.parts.size(); ++i) {
    const PartModel& part = parts[group.parts[i]];
    joiner.Add(part, group.group_from_part[i]);
    for (const auto& [image_id, image] : part.images) {
      const auto found = best.find(image_id);
      if (found == best.end() || image.points.size() > found->second.first) {
        best[image_id] = {image.points.size(), i};
      }
    }
  }
  colmap::Reconstruction model;
  for (const auto& [camera_id, camera] : JoinCameras(scene, parts, group)) {
    model.AddCamera(camera);
  }
  for (const auto& [image_id, choice] : best) {
    const PartImage& part_image =
        parts[group.parts[choice.second]].images.at(image_id);
    const Similarity3d& frame = group.group_from_part[choice.second];
    const Eigen::Quaterniond rotation =
        (part_image.cam_from_part.rotation * frame.rotation.conjugate())
            .normalized();
    colmap::Image image = scene.images.at(image_id);
    SetCamFromWorld({rotation, Eigen::Vector3d::Zero()}, &image);
    SetCenterInWorld(frame * part_image.cam_from_part.TargetOriginInSource(),
                     &image);
    model.AddImage(image);
    model.RegisterImage(image_id);
  }
  for (const JoinedPoint& point : joiner.Points()) {
    colmap::Track track;
    for (const auto& [image_id, point2D_idx] : point.elements) {
      track.AddElement(image_id, point2D_idx);
    }
    model.AddPoint3D(point.xyz, track);
  }
  return model;
}

}  // namespace dgsfm
