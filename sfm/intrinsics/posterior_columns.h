// The unknowns of an intrinsics posterior: the images that it rests on, and the
// columns that their poses and intrinsics have in its normal equations.

#pragma once

#include "estimators/optimization/camera_projection.h"
#include "sfm/intrinsics/intrinsics_posterior.h"

#include <array>
#include <map>
#include <vector>

namespace dgsfm {

constexpr int kNumPoseParams = 6;

class PosteriorColumns {
 public:
  // Those of a pose, then those of the camera's parameters; -1 where held.
  using ImageColumns = std::array<int, kNumPoseParams + kMaxNumCameraParams>;

  struct Prior {
    int column = 0;
    double stddev = 0;
    // Deviation of the model's value from the mean.
    double deviation = 0;
  };

  // Intrinsics that some images share.
  struct Block {
    // Their camera, of a group the first.
    colmap::camera_t camera_id = colmap::kInvalidCameraId;
    // By parameter; -1 where held.
    std::vector<int> columns;
  };

  // The arguments of EstimateIntrinsicsPosterior, which must outlive this.
  PosteriorColumns(const IntrinsicsPriorOptions& options,
                   const CameraBeliefs& beliefs,
                   const colmap::Reconstruction& model,
                   IntrinsicsBlocks blocks,
                   size_t max_num_images);

  // The key of the block that an image is in.
  uint32_t BlockOf(const colmap::Image& image) const;

  // Chosen images in increasing order, and the columns of each.
  std::vector<colmap::image_t> image_ids;
  std::vector<ImageColumns> columns;
  std::map<uint32_t, Block> blocks;
  std::vector<Prior> priors;
  int num_columns = 0;

 private:
  colmap::camera_t CameraIdOf(const colmap::Image& image) const;
  void AddIntrinsics(colmap::camera_t camera_id, Block* block);
  void FixGauge();

  const IntrinsicsPriorOptions& options_;
  const CameraBeliefs& beliefs_;
  const colmap::Reconstruction& model_;
  const IntrinsicsBlocks sharing_;
};

}  // namespace dgsfm
