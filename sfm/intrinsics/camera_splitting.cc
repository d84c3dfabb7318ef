#include "sfm/intrinsics/camera_splitting.h"

#include "sfm/mapping/model_access.h"

#include <algorithm>

namespace dgsfm {

namespace {

using Part = std::set<colmap::camera_t>;

// The next id after `id` that no camera of the scene has. Ids go on from 1
// after the greatest one, which stands for no camera.
colmap::camera_t NextFreeCameraId(const Scene& scene, colmap::camera_t id) {
  do {
    ++id;
  } while (id == 0 || id == colmap::kInvalidCameraId ||
           scene.cameras.count(id) > 0);
  return id;
}

}  // namespace

ImageCameras CamerasOf(const Scene& scene,
                       const std::vector<colmap::image_t>& image_ids) {
  ImageCameras result;
  for (const colmap::image_t image_id : image_ids) {
    const colmap::camera_t camera_id = scene.images.at(image_id).CameraId();
    result.camera_of_image[image_id] = camera_id;
    result.cameras.emplace(camera_id, scene.cameras.at(camera_id));
  }
  colmap::camera_t own_id = scene.cameras.rbegin()->first;
  for (const auto& [image_id, image] : scene.images) {
    own_id = NextFreeCameraId(scene, own_id);
    if (result.camera_of_image.count(image_id) > 0) {
      result.own_ids[image_id] = own_id;
    }
  }
  return result;
}

std::set<colmap::camera_t> SharedCameras(const ImageCameras& cameras) {
  std::set<colmap::camera_t> seen, shared;
  for (const auto& [image_id, camera_id] : cameras.camera_of_image) {
    if (!seen.insert(camera_id).second) shared.insert(camera_id);
  }
  return shared;
}

void SplitCameras(const std::set<colmap::camera_t>& camera_ids,
                  ImageCameras* cameras) {
  std::set<colmap::camera_t> seen;
  for (auto& [image_id, camera_id] : cameras->camera_of_image) {
    if (camera_ids.count(camera_id) == 0 || seen.insert(camera_id).second) {
      continue;
    }
    const colmap::camera_t own_id = cameras->own_ids.at(image_id);
    colmap::Camera camera = cameras->cameras.at(camera_id);
    camera.SetCameraId(own_id);
    cameras->cameras.emplace(own_id, camera);
    cameras->origins[own_id] = camera_id;
    camera_id = own_id;
  }
}

void AddSplitCameras(const CameraOrigins& origins, CameraBeliefs* beliefs) {
  for (const auto& [camera_id, origin] : origins) {
    if (beliefs->given.count(camera_id) > 0) continue;
    colmap::Camera camera = beliefs->given.at(origin);
    camera.SetCameraId(camera_id);
    beliefs->given.emplace(camera_id, camera);
    const auto label = beliefs->labels.find(origin);
    if (label != beliefs->labels.end()) {
      beliefs->labels[camera_id] = label->second;
    }
    const auto prior = beliefs->focal_priors.find(origin);
    if (prior != beliefs->focal_priors.end()) {
      beliefs->focal_priors[camera_id] = prior->second;
    }
  }
}

void UntieImages(const ImageCameras& cameras,
                 const std::vector<colmap::image_t>& image_ids,
                 std::vector<CameraGroup>* groups) {
  constexpr double kMaxUntiedShare = 0.25;
  std::map<colmap::camera_t, Part> cameras_of_entry;
  for (const auto& [camera_id, origin] : cameras.origins) {
    cameras_of_entry[origin].insert({origin, camera_id});
  }
  std::map<colmap::camera_t, size_t> num_images;
  for (const auto& [image_id, camera_id] : cameras.camera_of_image) {
    ++num_images[camera_id];
  }
  Part untied;
  for (const colmap::image_t image_id : image_ids) {
    untied.insert(cameras.camera_of_image.at(image_id));
  }

  std::vector<Part> parts;
  for (const CameraGroup& group : *groups) {
    Part& part = parts.emplace_back();
    for (const colmap::camera_t camera_id : group.camera_ids) {
      part.insert(camera_id);
      // Its entry may be split since then.
      const auto entry = cameras_of_entry.find(camera_id);
      if (entry == cameras_of_entry.end()) continue;
      part.insert(entry->second.begin(), entry->second.end());
      cameras_of_entry.erase(entry);
    }
  }
  for (const auto& [origin, part] : cameras_of_entry) parts.push_back(part);

  groups->clear();
  for (const Part& part : parts) {
    CameraGroup group;
    size_t count = 0, untied_count = 0;
    for (const colmap::camera_t camera_id : part) {
      count += num_images[camera_id];
      if (untied.count(camera_id) > 0) {
        untied_count += num_images[camera_id];
      } else {
        group.camera_ids.push_back(camera_id);
      }
    }
    if (group.camera_ids.size() < 2 ||
        double(untied_count) > kMaxUntiedShare * double(count)) {
      continue;
    }
    groups->push_back(group);
  }
}

void UseCameras(const ImageCameras& cameras, colmap::Reconstruction* model) {
  for (const auto& [image_id, unused] : model->Images()) {
    const colmap::camera_t camera_id = cameras.camera_of_image.at(image_id);
    if (!model->ExistsCamera(camera_id)) {
      model->AddCamera(cameras.cameras.at(camera_id));
    }
    model->Image(image_id).SetCameraId(camera_id);
  }
}

std::map<colmap::camera_t, colmap::camera_t> JoinedCameraIds(
    const CameraOrigins& origins,
    const std::vector<CameraGroup>& groups,
    const colmap::Reconstruction& model) {
  const auto origin_of = [&](colmap::camera_t camera_id) {
    const auto origin = origins.find(camera_id);
    return origin == origins.end() ? camera_id : origin->second;
  };
  const auto group_of = [&](colmap::camera_t camera_id) {
    for (const CameraGroup& group : groups) {
      if (group.Contains(camera_id)) return group.camera_ids.front();
    }
    return camera_id;
  };
  // By entry and group.
  std::map<colmap::camera_t, std::map<colmap::camera_t, Part>> parts;
  for (const auto& [camera_id, camera] : model.Cameras()) {
    parts[origin_of(camera_id)][group_of(camera_id)].insert(camera_id);
  }
  std::map<colmap::camera_t, colmap::camera_t> joined;
  for (const auto& [entry_id, parts_of_entry] : parts) {
    const auto largest =
        std::max_element(parts_of_entry.begin(),
                         parts_of_entry.end(),
                         [](const auto& a, const auto& b) {
                           return a.second.size() != b.second.size()
                                      ? a.second.size() < b.second.size()
                                      : *a.second.begin() > *b.second.begin();
                         });
    // The smallest id of another part may be that of the entry.
    const colmap::camera_t freed_id = *largest->second.begin();
    for (const auto& [group_id, part] : parts_of_entry) {
      colmap::camera_t id = *part.begin();
      if (group_id == largest->first) {
        id = entry_id;
      } else if (id == entry_id) {
        id = freed_id;
      }
      for (const colmap::camera_t camera_id : part) joined[camera_id] = id;
    }
  }
  return joined;
}

}  // namespace dgsfm
