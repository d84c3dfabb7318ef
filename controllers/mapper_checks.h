// What the mapper checks and reads of images and positions beside the scene.

#pragma once

#include "colmap_ext/scene.h"
#include "controllers/global_depth_mapper_options.h"
#include "controllers/pose_prior_loader.h"
#include "sfm/global_mapping.h"

#include <string>

namespace dgsfm {

// Throws std::runtime_error, with the number of images that the folder lacks
// and the first of them.
void CheckImagesExist(const std::string& image_path, const Scene& scene);

// Reads EXIF data for the cameras that have neither a prior focal length nor
// EXIF data, of each the first image's.
void ReadExif(const std::string& image_path, Scene* scene);

// Adds the warnings of loading the positions, and one if latitude and longitude
// seem to be swapped by the largest model.
void WarnOfPositions(const GeoreferencingOptions& options,
                     const LoadedPosePriors& loaded,
                     DepthGlobalMapperResult* result);

// Warns of images with depth that EXIF turns in a way that the shape of their
// maps does not show.
void WarnOfTurnedImages(const GlobalDepthMapperOptions& options,
                        const Scene& scene,
                        const KeypointDepthMap& depths);

}  // namespace dgsfm
