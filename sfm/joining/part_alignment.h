// Similarities between models of parts, and to the positions of their images.

#pragma once

#include "colmap_ext/pose_prior.h"
#include "estimators/averaging/graph_averaging.h"
#include "estimators/averaging/similarity_averaging.h"
#include "sfm/joining/part_model.h"

#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

struct PartJoiningOptions {
  // Images that two models must share to be compared.
  int min_num_shared_images = 3;
  // Share of these that must agree [1]. Images agree whose rotations differ by
  // at most max_rotation_error_deg [deg], and whose centres by at most
  // max_center_error [median depth of the image's points], in the frame of
  // both.
  double min_agreeing_share = 0.6;
  double max_rotation_error_deg = 1.0;
  double max_center_error = 0.02;
  GraphAveragingOptions averaging;

  bool IsValid(std::string* error) const;
};

// Two parts that share images.
struct PartPair {
  // Indices of the parts.
  int part1 = 0;
  int part2 = 0;
  std::vector<colmap::image_t> shared;
  // Between them alone; nothing if there is none that most images agree with.
  std::optional<RelativeSimilarity> similarity;
};

// The pairs of parts that share enough images, aligned by the points that these
// see and by their centres.
std::vector<PartPair> FindPartPairs(const PartJoiningOptions& options,
                                    const std::vector<PartModel>& parts);

// The images that two parts have in the same place, in a frame of both.
size_t CountAgreeing(const PartJoiningOptions& options,
                     const std::vector<PartModel>& parts,
                     const PartPair& pair,
                     const Similarity3d& frame_from_1,
                     const Similarity3d& frame_from_2);

// The similarity from a part, which is node `part_node`, to the frame of the
// positions, which is node `position_node`; nothing if they hardly hold it.
std::optional<RelativeSimilarity> AlignPartToPositions(
    const PosePriors& positions,
    const PartModel& part,
    int part_node,
    int position_node);

}  // namespace dgsfm
