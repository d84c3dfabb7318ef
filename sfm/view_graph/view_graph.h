// The view graph: images as nodes, valid pairs as edges, and the filters that
// take edges out, each with its reason as PairStatus.

#pragma once

#include "estimators/averaging/graph.h"
#include "sfm/verification/pair_verification.h"

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace dgsfm {

// Scores of image pairs in [0, 1] that they show the same surface
// (Doppelgangers++), by pair id.
using PairScores = std::map<colmap::image_pair_t, double>;

struct ViewGraphFilterOptions {
  // Pairs with an imported score at or below this are removed (paper: tau_DG);
  // pairs without a score are kept.
  double min_pair_score = 0.8;
  // Pairs whose mean triplet support is at or below this are removed (paper:
  // tau_tri = 0.6). 0 = no filter: it takes more than half of the true pairs,
  // and what false ones are left after depth consistency contradict rotations
  // and translations.
  double min_triplet_support = 0;

  bool IsValid(std::string* error) const;
};

PairTotals CountPairs(const PairGeometries& pairs);

// Takes out pairs by imported score; returns their number.
size_t FilterByPairScore(const PairScores& scores,
                         const ViewGraphFilterOptions& options,
                         PairGeometries* pairs);

// Takes out pairs by triplet support; returns their number.
size_t FilterByTripletSupport(const ViewGraphFilterOptions& options,
                              PairGeometries* pairs);

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
