#include "sfm/intrinsics/camera_groups.h"

#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>
#include <utility>

namespace dgsfm {

std::map<colmap::camera_t, int> CameraKinds(const CameraBeliefs& beliefs) {
  // Focal lengths from EXIF data that are farther apart are different zooms:
  // those of one zoom differ by rounding only.
  constexpr double kMaxLogFocalDifference = 0.002;
  using Key =
      std::tuple<int, size_t, size_t, std::string, std::vector<double>, bool>;
  struct Member {
    double log_focal = 0;
    colmap::camera_t camera_id = colmap::kInvalidCameraId;
  };
  std::map<Key, std::vector<Member>> classes;
  for (const auto& [camera_id, camera] : beliefs.given) {
    const auto label = beliefs.labels.find(camera_id);
    const auto prior = beliefs.focal_priors.find(camera_id);
    const bool has_prior = prior != beliefs.focal_priors.end();
    const Key key = {
        camera.ModelId(),
        camera.Width(),
        camera.Height(),
        label == beliefs.labels.end() ? "" : label->second,
        camera.HasPriorFocalLength() ? camera.Params() : std::vector<double>(),
        has_prior};
    classes[key].push_back(
        {has_prior ? std::log(prior->second.focal_px) : 0, camera_id});
  }
  std::map<colmap::camera_t, int> kinds;
  int kind = 0;
  for (auto& [key, members] : classes) {
    std::stable_sort(
        members.begin(), members.end(), [](const Member& a, const Member& b) {
          return a.log_focal < b.log_focal;
        });
    double first_log_focal = 0;
    for (size_t i = 0; i < members.size(); ++i) {
      if (i == 0 ||
          members[i].log_focal - first_log_focal > kMaxLogFocalDifference) {
        ++kind;
        first_log_focal = members[i].log_focal;
      }
      kinds[members[i].camera_id] = kind;
    }
  }
  return kinds;
}

std::vector<CameraGroup> FindCameraClasses(
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  const std::map<colmap::camera_t, int> kinds = CameraKinds(beliefs);
  std::map<int, std::set<colmap::camera_t>> classes;
  for (const auto& [image_id, image] : model.Images()) {
    const colmap::camera_t camera_id = image.CameraId();
    if (PriorStddevs(prior, beliefs, camera_id)(0) > 0) {
      classes[kinds.at(camera_id)].insert(camera_id);
    }
  }
  std::vector<CameraGroup> groups;
  for (const auto& [kind, camera_ids] : classes) {
    if (camera_ids.size() < 2) continue;
    groups.emplace_back().camera_ids.assign(camera_ids.begin(),
                                            camera_ids.end());
  }
  return groups;
}

void RenameCameras(const std::map<colmap::camera_t, colmap::camera_t>& new_ids,
                   colmap::Reconstruction* model) {
  colmap::Reconstruction renamed;
  for (const auto& [image_id, original] : model->Images()) {
    colmap::Image image = original;
    const auto new_id = new_ids.find(image.CameraId());
    if (new_id != new_ids.end()) image.SetCameraId(new_id->second);
    if (!renamed.ExistsCamera(image.CameraId())) {
      colmap::Camera camera = model->Camera(original.CameraId());
      camera.SetCameraId(image.CameraId());
      renamed.AddCamera(camera);
    }
    for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
      if (image.Point2D(i).HasPoint3D()) image.ResetPoint3DForPoint2D(i);
    }
    image.SetRegistered(false);
    renamed.AddImage(image);
    if (original.IsRegistered()) renamed.RegisterImage(image_id);
  }
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    const colmap::Point3D& point = model->Point3D(point_id);
    const colmap::point3D_t renamed_id =
        renamed.AddPoint3D(point.XYZ(), point.Track(), point.Color());
    renamed.Point3D(renamed_id).SetError(point.Error());
  }
  *model = std::move(renamed);
}

std::map<colmap::camera_t, colmap::camera_t> FirstOfGroups(
    const std::vector<CameraGroup>& groups) {
  std::map<colmap::camera_t, colmap::camera_t> first_ids;
  for (const CameraGroup& group : groups) {
    for (const colmap::camera_t camera_id : group.camera_ids) {
      first_ids[camera_id] = group.camera_ids.front();
    }
  }
  return first_ids;
}

void KeepGroupsOf(const colmap::Reconstruction& model,
                  std::vector<CameraGroup>* groups) {
  for (CameraGroup& group : *groups) {
    std::vector<colmap::camera_t>& ids = group.camera_ids;
    ids.erase(std::remove_if(ids.begin(),
                             ids.end(),
                             [&](colmap::camera_t camera_id) {
                               return !model.ExistsCamera(camera_id);
                             }),
              ids.end());
  }
  groups->erase(std::remove_if(groups->begin(),
                               groups->end(),
                               [](const CameraGroup& group) {
                                 return group.camera_ids.size() < 2;
                               }),
                groups->end());
}

}  // namespace dgsfm
