// Cameras of a model that are one physical camera at one zoom, although each
// image came with its own.

#pragma once

#include "estimators/intrinsics/camera_grouping.h"
#include "sfm/intrinsics/intrinsics_posterior.h"

#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

namespace dgsfm {

// Number of the kind of each camera. Cameras of one kind may be the same for
// all that is known without a look at their images: camera model, image size,
// camera and zoom as EXIF data have them (else the folder of the images),
// intrinsics where they are calibrated, and focal lengths by EXIF data within
// 0.2 %.
std::map<colmap::camera_t, int> CameraKinds(const CameraBeliefs& beliefs);

// Groups of cameras of one kind, in no group yet, that GroupCameras takes for
// the same from their adjusted intrinsics. The prior odds grow with the share
// of cameras of that kind, squared: one where all images have it, as of one
// photographer.
std::vector<CameraGroup> FindCameraGroups(const CameraGroupingOptions& options,
                                          const CameraBeliefs& beliefs,
                                          const IntrinsicsPosterior& posterior,
                                          const colmap::Reconstruction& model);

// A rigid group of each kind of cameras that registered images have two of or
// more: the same camera for all that is known without a look at the images.
std::vector<CameraGroup> FindCameraClasses(const IntrinsicsPriorOptions& prior,
                                           const CameraBeliefs& beliefs,
                                           const colmap::Reconstruction& model);

// Images whose focal lengths differ from that of the camera or rigid group that
// they share, by what each of these images determines by itself (`by_image`, at
// a model that is adjusted with shared intrinsics): those far from the mean, or
// all where the deviations are large together. Ascending.
std::vector<colmap::image_t> FindDeviatingImages(
    const CameraGroupingOptions& options,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& by_image,
    const colmap::Reconstruction& model);

// Cameras in no group yet that may be the same by their focal lengths alone.
std::vector<CameraGroup> FindCandidateGroups(
    const CameraGroupingOptions& options,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model);

// Cameras of a model adjusted with free principal points whose principal points
// stay at the given ones. Free remain
// - those that several images share, as one camera or as a group, and of which
//   errors and prior leave less than half the uncertainty of the prior in every
//   direction, unless the given one is likelier, by the errors of key points,
//   than one drawn from the prior;
// - those off the given ones by more than errors explain, and by more than
//   prior.crop_factor standard deviations of the prior: crops.
std::set<colmap::camera_t> FindHeldPrincipalPoints(
    const CameraGroupingOptions& options,
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model);

// Gives the images of each camera of a model, with its parameters, the camera
// of another id, and removes cameras without images. Cameras that get one id
// have the same parameters; cameras that are not listed keep theirs. Points get
// new ids.
void RenameCameras(const std::map<colmap::camera_t, colmap::camera_t>& new_ids,
                   colmap::Reconstruction* model);

// The first camera of the rigid group for each camera in one.
std::map<colmap::camera_t, colmap::camera_t> FirstOfRigidGroups(
    const std::vector<CameraGroup>& groups);

// Takes cameras out of the groups that the model no longer has, and groups out
// that lose all but one.
void KeepGroupsOf(const colmap::Reconstruction& model,
                  std::vector<CameraGroup>* groups);

}  // namespace dgsfm
