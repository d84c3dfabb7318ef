// What the posterior of the intrinsics decides: images that contradict the
// intrinsics they share, and principal points and distortions that stay at the
// given ones.

#pragma once

#include "sfm/intrinsics/intrinsics_posterior.h"

#include <set>
#include <vector>

namespace dgsfm {

// Images whose focal lengths differ from that of the camera or group that they
// share, by what each of these images determines by itself (`by_image`, at a
// model that is adjusted with shared intrinsics): those far from the mean, or
// all, images without a posterior included, where the deviations are large
// together. Ascending.
std::vector<colmap::image_t> FindDeviatingImages(
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& by_image,
    const colmap::Reconstruction& model);

// Cameras of a model adjusted with free principal points whose principal points
// stay at the given ones. Free remain
// - those that several images share, as one camera or as a group, and of which
//   errors and prior leave less than half the uncertainty of the prior in every
//   direction, unless the given one is likelier, by the errors of key points,
//   than one drawn from the prior;
// - those off the given ones by more than errors explain (chi-square of all
//   cameras together), and by more than prior.crop_factor standard deviations
//   of the prior: crops.
std::set<colmap::camera_t> FindHeldPrincipalPoints(
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model);

// Cameras of such a model, of several images each, whose distortions stay at
// the given ones: by the errors of key points these are likelier than ones
// drawn from the prior. Undistorted photos have none, and what errors make of
// it bends long models.
std::set<colmap::camera_t> FindHeldDistortions(
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model);

}  // namespace dgsfm
