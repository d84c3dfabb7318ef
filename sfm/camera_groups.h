// Cameras of a model that are one physical camera at one zoom, although each
// image came with its own.

#pragma once

#include "estimators/camera_grouping.h"
#include "sfm/intrinsics_posterior.h"

#include <vector>

namespace dgsfm {

// Groups of cameras of one camera model and image size that GroupCameras takes
// for the same from their adjusted intrinsics. The prior odds grow with the
// share of cameras of that size, squared: one where all images have it, as of
// one photographer. Cameras with a prior focal length stay as the user gave
// them, in no group.
std::vector<CameraGroup> FindCameraGroups(const CameraGroupingOptions& options,
                                          const IntrinsicsPosterior& posterior,
                                          const colmap::Reconstruction& model);

// Whether nothing speaks against the principal points of the database: they
// have moved by no more than errors explain.
bool PrincipalPointsAreAsGiven(const CameraGroupingOptions& options,
                               const CameraMap& prior_cameras,
                               const IntrinsicsPosterior& posterior);

// Sets the principal points of a model to those of the database.
void ResetPrincipalPoints(const CameraMap& prior_cameras,
                          colmap::Reconstruction* model);

// Gives all images of a rigid group its first camera and removes the others.
// Points get new ids.
void ShareIntrinsics(const std::vector<CameraGroup>& groups,
                     colmap::Reconstruction* model);

// Takes cameras out of the groups that the model no longer has, and groups out
// that lose all but one.
void KeepGroupsOf(const colmap::Reconstruction& model,
                  std::vector<CameraGroup>* groups);

}  // namespace dgsfm
