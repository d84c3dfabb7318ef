// Start of the camera centres and points: chained along a spanning tree and
// lifted from depth where depth fixes the scale, grown by resection and
// triangulation with known rotations where it does not.

#pragma once

#include "sfm/view_graph/translation_filter.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>
#include <colmap/base/track.h>

#include <vector>

namespace dgsfm {

struct PositionInitializationOptions {
  // Whether centres and points start from depth; otherwise from the strongest
  // pair, at unit scale, as without depth maps.
  bool use_depth = true;
};

// Sets the centres of the images of the index, whose rotations are final, and
// adds the tracks as points. Scaled pairs give centres of images that have a
// scale: c_j = c_i - R_j^T s_i t_ij along the maximum spanning tree by number
// of inliers (DGSfM Eq. 12, 13); points are component-wise medians of the
// lifted observations (Eq. 14 to 16, with z-depth). The other images follow by
// number of tracks already placed: their centre is the robust least-squares
// intersection of the viewing rays of these tracks. Images that never see six
// placed tracks stay unregistered; tracks with fewer than two registered
// images, or without depth and with rays that enclose less than
// min_triangulation_angle_deg, are not added. Without scaled pairs the model
// grows in the same way from the averaged centres, or from a seed pair where
// that reaches more images. Returns the number of registered images.
size_t InitializePositions(const ImageIndex& index,
                           const PairGeometries& pairs,
                           const KeypointDepthMap& depths,
                           const ImageScales& scales,
                           const std::vector<colmap::Track>& tracks,
                           const PositionInitializationOptions& options,
                           double min_triangulation_angle_deg,
                           colmap::Reconstruction* reconstruction,
                           const FrameMembers& frames = {},
                           const AveragedCenters& averaged_centers = {});

}  // namespace dgsfm
