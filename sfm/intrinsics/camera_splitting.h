// Camera entries whose images turn out to have intrinsics of their own.

#pragma once

#include "sfm/intrinsics/intrinsics_prior.h"

#include <map>
#include <set>
#include <vector>

namespace dgsfm {

// The entry of the database that a camera was made of, by its id.
using CameraOrigins = std::map<colmap::camera_t, colmap::camera_t>;

// The cameras of some images, which start as those of the scene.
struct ImageCameras {
  CameraMap cameras;
  std::map<colmap::image_t, colmap::camera_t> camera_of_image;
  // Ids for cameras of their own, which no camera of the scene has: different
  // for all images, so that parts of a scene can be split by themselves.
  std::map<colmap::image_t, colmap::camera_t> own_ids;
  CameraOrigins origins;
};
ImageCameras CamerasOf(const Scene& scene,
                       const std::vector<colmap::image_t>& image_ids);

// Cameras of more than one image.
std::set<colmap::camera_t> SharedCameras(const ImageCameras& cameras);

// Gives each image of some cameras a camera of its own, with the same
// parameters: the first image keeps the camera.
void SplitCameras(const std::set<colmap::camera_t>& camera_ids,
                  ImageCameras* cameras);

// Gives cameras that were made of an entry the beliefs about that.
void AddSplitCameras(const CameraOrigins& origins, CameraBeliefs* beliefs);

// Takes images out of the groups of their cameras, which are cameras of
// single images if `origins` has them. Groups that would lose more than a
// quarter of their images come to an end.
//
// Entries that were split since the groups were formed count as groups of their
// images.
void UntieImages(const ImageCameras& cameras,
                 const std::vector<colmap::image_t>& image_ids,
                 std::vector<CameraGroup>* groups);

// Gives the images of a model their cameras.
void UseCameras(const ImageCameras& cameras, colmap::Reconstruction* model);

// Ids under which the cameras of a model are written: cameras that were made of
// one entry and are in one group become one again. The largest part of an
// entry, of equal ones that of the first camera, has the id of the entry;
// others keep the smallest id of their cameras.
std::map<colmap::camera_t, colmap::camera_t> JoinedCameraIds(
    const CameraOrigins& origins,
    const std::vector<CameraGroup>& groups,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
