// Cameras of a model that are one physical camera at one zoom, although each
// image came with its own.

#pragma once

#include "sfm/intrinsics/intrinsics_prior.h"

#include <map>
#include <vector>

namespace dgsfm {

// Number of the kind of each camera. Cameras of one kind may be the same for
// all that is known without a look at their images: camera model, image size,
// camera and zoom as EXIF data have them (else the folder of the images),
// intrinsics where they are calibrated, and focal lengths by EXIF data within
// 0.2 %.
std::map<colmap::camera_t, int> CameraKinds(const CameraBeliefs& beliefs);

// A group of each kind of cameras that the images of a model have two of or
// more: the same camera for all that is known without a look at the images.
// Images that are not registered yet get the intrinsics of the others.
std::vector<CameraGroup> FindCameraClasses(const IntrinsicsPriorOptions& prior,
                                           const CameraBeliefs& beliefs,
                                           const colmap::Reconstruction& model);

// Gives the images of each camera of a model, with its parameters, the camera
// of another id, and removes cameras without images. Cameras that get one id
// have the same parameters; cameras that are not listed keep theirs. Points get
// new ids.
void RenameCameras(const std::map<colmap::camera_t, colmap::camera_t>& new_ids,
                   colmap::Reconstruction* model);

// The first camera of the group for each camera in one.
std::map<colmap::camera_t, colmap::camera_t> FirstOfGroups(
    const std::vector<CameraGroup>& groups);

// Takes cameras out of the groups that the model no longer has, and groups out
// that lose all but one.
void KeepGroupsOf(const colmap::Reconstruction& model,
                  std::vector<CameraGroup>* groups);

}  // namespace dgsfm
