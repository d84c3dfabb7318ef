// Bundle adjustment of a joined model, one block of images after another.

#pragma once

#include "sfm/joining/joined_model.h"
#include "sfm/mapping/bundle_adjustment.h"

#include <optional>
#include <string>

namespace dgsfm {

struct BlockAdjustmentOptions {
  // Each sweep adjusts every block once.
  int max_num_sweeps = 30;
  // Relative decrease of the cost by a sweep that ends them [1].
  double min_cost_decrease = 1e-4;
  // Observations that are farther off after the first sweep leave [px].
  double max_reprojection_error_px = 4;
  // Whether the loss is adapted to the errors of the joined model.
  bool adapt_loss = true;
  // The adjustment of a block; intrinsics are held.
  BundleAdjustmentOptions bundle_adjustment;

  bool IsValid(std::string* error) const;
};

struct BlockAdjustmentSummary {
  int num_sweeps = 0;
  bool converged = false;
  size_t num_filtered = 0;
  // Root of twice the mean robust cost of an observation before and after [px].
  double initial_robust_rms_px = 0;
  double final_robust_rms_px = 0;
};

// Minimises the robust reprojection errors over poses and points by block
// Gauss-Seidel: each step adjusts the images of one part and the points that
// they see, and holds all other images. Parts overlap, so that an image at the
// border of one is inside another; blocks converge in a few sweeps where the
// parts are in one frame already, but bends that are longer than a part hardly
// change. Memory beside the model is that of one block. Intrinsics are held.
// Images of a frame move together; prior centres, if any, add their costs.
// Nothing if a solver failed. The same for any number of threads.
std::optional<BlockAdjustmentSummary> AdjustBlocks(
    const BlockAdjustmentOptions& options,
    int num_threads,
    const RigConstraints& rigs,
    const CenterPriors& center_priors,
    JoinedModel* model);

}  // namespace dgsfm
