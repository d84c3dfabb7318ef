#include "sfm/joining/camera_joining.h"

#include <algorithm>
#include <tuple>

namespace dgsfm {

namespace {

void AddCamera(colmap::camera_t camera_id,
               colmap::Camera camera,
               colmap::Reconstruction* model) {
  camera.SetCameraId(camera_id);
  model->AddCamera(camera);
}

}  // namespace

void MeanCamera::Add(const colmap::Camera& camera, size_t num_observations) {
  if (num_observations == 0) return;
  if (num_observations > max_num_observations_) {
    max_num_observations_ = num_observations;
    if (sum_.size() == 0 || camera_.ModelId() != camera.ModelId()) {
      sum_ = Eigen::VectorXd::Zero(Eigen::Index(camera.NumParams()));
      num_observations_ = 0;
    }
    camera_ = camera;
  }
  if (camera_.ModelId() != camera.ModelId()) return;
  sum_ += double(num_observations) *
          Eigen::Map<const Eigen::VectorXd>(camera.ParamsData(),
                                            Eigen::Index(camera.NumParams()));
  num_observations_ += double(num_observations);
}

colmap::Camera MeanCamera::Mean() const {
  colmap::Camera mean = camera_;
  const Eigen::VectorXd params = sum_ / num_observations_;
  mean.SetParams({params.data(), params.data() + params.size()});
  return mean;
}

CameraJoiner::CameraJoiner(const Scene& scene,
                           const std::vector<PartModel>& parts,
                           const PartGroup& group)
    : scene_(scene), parts_(parts) {
  for (const auto& [camera_id, camera] : scene.cameras) {
    next_id_ = std::max(next_id_, camera_id + 1);
  }
  for (const int part : group.parts) TieEntries(part);
  for (const int part : group.parts) AddToMeans(part);
}

colmap::camera_t CameraJoiner::CameraOf(colmap::image_t image_id, int part) {
  const colmap::camera_t entry_id = EntryOf(image_id);
  const colmap::camera_t camera_id = parts_[part].images.at(image_id).camera_id;
  if (camera_id == entry_id && means_[RootOf(entry_id)].Exists()) {
    used_entries_.insert(entry_id);
    return entry_id;
  }
  const auto [it, is_new] = own_.emplace(std::make_pair(part, camera_id), 0);
  if (is_new) it->second = next_id_++;
  return it->second;
}

void CameraJoiner::WriteTo(colmap::Reconstruction* model) {
  for (const colmap::camera_t camera_id : used_entries_) {
    AddCamera(camera_id, means_.at(RootOf(camera_id)).Mean(), model);
  }
  for (const auto& [origin, camera_id] : own_) {
    AddCamera(camera_id, parts_[origin.first].cameras.at(origin.second), model);
  }
}

colmap::camera_t CameraJoiner::EntryOf(colmap::image_t image_id) const {
  return scene_.images.at(image_id).CameraId();
}

colmap::camera_t CameraJoiner::RootOf(colmap::camera_t entry_id) {
  colmap::camera_t& parent = parents_.emplace(entry_id, entry_id).first->second;
  if (parent != entry_id) parent = RootOf(parent);
  return parent;
}

// Makes entries of the same parameters one.
void CameraJoiner::TieEntries(int part) {
  std::map<std::tuple<int, size_t, size_t, std::vector<double>>,
           colmap::camera_t>
      entries;
  for (const auto& [image_id, image] : parts_[part].images) {
    if (image.camera_id != EntryOf(image_id)) continue;
    const colmap::Camera& camera = parts_[part].cameras.at(image.camera_id);
    const auto [it, is_new] =
        entries.emplace(std::make_tuple(int(camera.ModelId()),
                                        camera.Width(),
                                        camera.Height(),
                                        camera.Params()),
                        image.camera_id);
    if (!is_new) parents_[RootOf(image.camera_id)] = RootOf(it->second);
  }
}

void CameraJoiner::AddToMeans(int part) {
  std::map<colmap::camera_t, size_t> num_observations;
  for (const auto& [image_id, image] : parts_[part].images) {
    if (image.camera_id != EntryOf(image_id)) continue;
    num_observations[image.camera_id] += image.observations.size();
  }
  for (const auto& [camera_id, count] : num_observations) {
    means_[RootOf(camera_id)].Add(parts_[part].cameras.at(camera_id), count);
  }
}

}  // namespace dgsfm
