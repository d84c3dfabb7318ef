// Depth maps of the images of a model refined by those of their neighbours,
// which are read when they are needed.

#pragma once

#include "controllers/sparse_model.h"
#include "estimators/multi_view_depth.h"
#include "estimators/view_neighbors.h"

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace dgsfm {

struct MultiViewRefinementOptions {
  ViewNeighborOptions neighbors;
  MultiViewDepthOptions depth;
  // How the maps were aligned. Fields are corrected first, by where the maps
  // agree.
  DepthAlignmentOptions alignment;
  // One per core if not positive.
  int num_threads = -1;

  bool IsValid(std::string* error) const;
};

struct ViewToRefine {
  std::string image_name;
  DepthAlignment alignment;
};

// Memory holds the maps of an image and of its neighbours and, for each thread,
// a refined one. Results are the same for any number of threads.
class MultiViewRefinement {
 public:
  // Loads the map of a view as it is before its alignment; called several times
  // and from any thread.
  using Load = std::function<DepthMap(size_t)>;
  // Called once for each view, from any thread.
  using Write = std::function<void(size_t, RefinedDepth)>;

  // All must outlive this; fields of the alignments are corrected.
  MultiViewRefinement(const SparseModel& model,
                      const MultiViewRefinementOptions& options,
                      std::vector<ViewToRefine>* views,
                      Load load);

  void Run(const Write& write);

 private:
  // The images of the batch that begins with this one.
  size_t BatchEnd(size_t begin) const;
  void Hold(size_t i);
  std::vector<const DepthView*> Neighbors(size_t i) const;
  std::vector<DepthCorrespondence> FindCorrespondences(size_t i) const;
  void CorrectFields();

  const SparseModel& model_;
  const MultiViewRefinementOptions& options_;
  std::vector<ViewToRefine>& views_;
  const Load load_;
  std::vector<std::vector<size_t>> neighbors_;
  // Aligned maps of the views that are needed at the moment.
  std::map<size_t, std::unique_ptr<DepthView>> loaded_;
};

}  // namespace dgsfm
