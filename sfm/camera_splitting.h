// Camera entries whose images turn out to have intrinsics of their own.

#pragma once

#include "sfm/intrinsics_prior.h"

#include <map>
#include <set>
#include <vector>

namespace dgsfm {

// The entry of the database that a camera was made of, by its id.
using CameraOrigins = std::map<colmap::camera_t, colmap::camera_t>;

// Cameras of images: those of more than one.
std::set<colmap::camera_t> SharedCameras(const Scene& scene);

// Gives each image of some cameras a camera of its own, with the same
// parameters, priors and EXIF data: the first image keeps the camera, the
// others get ids beyond all others, in the order of their ids, which `origins`
// lists.
void SplitCameras(const std::set<colmap::camera_t>& camera_ids,
                  Scene* scene,
                  CameraOrigins* origins);

// Gives cameras that were made of an entry the beliefs about that.
void AddSplitCameras(const CameraOrigins& origins, CameraBeliefs* beliefs);

// Takes images out of the rigid groups of their cameras, which are cameras of
// single images if `origins` has them. Groups that would lose more than a
// quarter of their images come to an end.
//
// Entries that were split since the groups were formed count as groups of their
// images.
void UntieImages(const Scene& scene,
                 const CameraOrigins& origins,
                 const std::vector<colmap::image_t>& image_ids,
                 std::vector<CameraGroup>* groups);

// Gives the images of a model the cameras that they have in a scene.
void UseCamerasOf(const Scene& scene, colmap::Reconstruction* model);

// Ids under which the cameras of a model are written: cameras that were made of
// one entry and are in one rigid group become one again. The largest part of an
// entry, of equal ones that of the first camera, has the id of the entry;
// others keep the smallest id of their cameras.
std::map<colmap::camera_t, colmap::camera_t> JoinedCameraIds(
    const CameraOrigins& origins,
    const std::vector<CameraGroup>& groups,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
