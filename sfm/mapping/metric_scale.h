// The scale of a model by its depth maps.

#pragma once

#include "sfm/verification/pair_verification.h"
#include "sfm/view_graph/component_averaging.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <string>

namespace dgsfm {

// Factors of the depth maps against the model: s_i = median over the points of
// image i of z-depth / prior depth, for images with enough of them, and the
// spread of the logarithms about it (1.4826 x median absolute deviation) [1].
struct DepthScale {
  double scale = 1;
  double log_spread = 0;
};
std::map<colmap::image_t, DepthScale> DepthScalesOfModel(
    const KeypointDepthMap& depths, const colmap::Reconstruction& model);

// Camera centres of the registered images in the world.
using ImageCenters = std::map<colmap::image_t, Eigen::Vector3d>;
ImageCenters CentersOf(const colmap::Reconstruction& model);

// What a model is measured in.
enum class ModelUnit {
  ARBITRARY,   // no depth map fixes its scale
  DEPTH_MAPS,  // the median unit of the maps: relative ones, or too different
  METRES,
  RIGS,  // that of the distances between the cameras of rigs
};
std::string ModelUnitName(ModelUnit unit);

// The unit by the depth scales of a model's metric maps, or of all its maps
// where none is metric, and their spread: the maps of one depth model are
// metric if their scales agree.
struct MeasuredUnit {
  ModelUnit unit = ModelUnit::ARBITRARY;
  size_t num_images = 0;
  // Whether these have metric maps.
  bool is_metric = false;
  // Median of the logarithms of the scales: what rigs or positions, where they
  // give the unit, differ from the maps by [1].
  double log_scale = 0;
  // Spread of the logarithms of the scales, 1.4826 x median absolute deviation
  // [1].
  double log_spread = 0;

  // Whether metric maps disagree too much to be that.
  bool IsDoubtful() const;
};
MeasuredUnit UnitOfModel(const KeypointDepthMap& depths,
                         const std::map<colmap::image_t, double>& depth_scales,
                         const colmap::Reconstruction& model);

// The same by the depth scales that the model has now.
MeasuredUnit UnitOfModel(const KeypointDepthMap& depths,
                         const colmap::Reconstruction& model);

// Scales the model so that the median of the depth scales that give its unit
// is one. Returns these as they were before.
MeasuredUnit NormalizeToDepth(const KeypointDepthMap& depths,
                              colmap::Reconstruction* model);

}  // namespace dgsfm
