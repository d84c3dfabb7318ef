// Cameras of a model that are one physical camera at one zoom, although each
// image came with its own.

#pragma once

#include "estimators/camera_grouping.h"
#include "sfm/intrinsics_posterior.h"

#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

namespace dgsfm {

// What cameras have in common that may be the same: camera model, image size,
// camera and zoom as EXIF has them, and the intrinsics where they are known.
using CameraKind =
    std::tuple<int, size_t, size_t, std::string, std::vector<double>>;
CameraKind KindOf(const CameraMap& given,
                  const std::map<colmap::camera_t, ImageExif>& exif,
                  colmap::camera_t camera_id);

// Groups of cameras of one camera model and image size that GroupCameras takes
// for the same from their adjusted intrinsics. The prior odds grow with the
// share of cameras of that size, squared: one where all images have it, as of
// one photographer. Cameras with a prior focal length may be the same as those
// that the user gave the same intrinsics.
std::vector<CameraGroup> FindCameraGroups(const CameraGroupingOptions& options,
                                          const CameraBeliefs& beliefs,
                                          const IntrinsicsPosterior& posterior,
                                          const colmap::Reconstruction& model);

// Cameras of registered images that may be the same for all that is known
// without a look at their intrinsics.
std::vector<CameraGroup> FindCameraClasses(const CameraGroupingOptions& options,
                                           const IntrinsicsPriorOptions& prior,
                                           const CameraBeliefs& beliefs,
                                           const colmap::Reconstruction& model);

// The same by focal lengths alone: all that may be the same.
std::vector<CameraGroup> FindCandidateGroups(
    const CameraGroupingOptions& options,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model);

// Cameras whose principal points, as far as errors allow to tell, are those of
// the database: of a group, where that is likelier than an offset drawn from
// the prior; of other cameras, where their offsets do not show.
std::set<colmap::camera_t> FindGivenPrincipalPoints(
    const CameraGroupingOptions& options,
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior);

// Gives all images of a rigid group its first camera and removes the others.
// Points get new ids.
void ShareIntrinsics(const std::vector<CameraGroup>& groups,
                     colmap::Reconstruction* model);

// Takes cameras out of the groups that the model no longer has, and groups out
// that lose all but one.
void KeepGroupsOf(const colmap::Reconstruction& model,
                  std::vector<CameraGroup>* groups);

}  // namespace dgsfm
