// The view graph: images as nodes, valid pairs as edges.

#pragma once

#include "estimators/averaging/graph.h"
#include "sfm/verification/pair_verification.h"

#include <utility>
#include <vector>

namespace dgsfm {

PairTotals CountPairs(const PairGeometries& pairs);

// Images of each connected component of the valid pairs and of the frames, in
// increasing order; the largest component first, ties by the smallest image id.
std::vector<std::vector<colmap::image_t>> ConnectedImages(
    const PairGeometries& pairs, const FrameMembers& frames = {});

// Compact node numbering of a set of images for the graph estimators.
class ImageIndex {
 public:
  explicit ImageIndex(const std::vector<colmap::image_t>& image_ids);
  int Size() const { return int(image_ids_.size()); }
  // -1 for images that are not in the set.
  int Of(colmap::image_t image_id) const;
  colmap::image_t IdOf(int index) const { return image_ids_[index]; }

 private:
  std::vector<colmap::image_t> image_ids_;
};

// Edges that join the images of each frame.
std::vector<GraphEdge> FrameEdges(const ImageIndex& index,
                                  const FrameMembers& frames);

// Pointers to the valid pairs among the images of an index, by pair id.
struct IndexedPair {
  int image1 = 0;
  int image2 = 0;
  PairGeometry* pair = nullptr;
};
std::vector<IndexedPair> ValidPairs(const ImageIndex& index,
                                    PairGeometries* pairs);

}  // namespace dgsfm
