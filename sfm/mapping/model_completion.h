// More observations for a model with poses, and its judgement of pairs.

#pragma once

#include "sfm/mapping/model_building.h"

#include <map>

namespace dgsfm {

// Matches of pairs that agree with a model.
using AgreeingMatches = std::map<colmap::image_pair_t, colmap::FeatureMatches>;

// Matches of the scene that agree with the poses of a model: those within
// refinement.max_epipolar_error_px of the epipolar lines, of the pairs that
// keep min_num_inliers and min_inlier_ratio of theirs. All these pairs have an
// entry, without the matches within one point. The poses of a model are better
// evidence than a pair alone, its depth or its triplets. Pairs removed by their
// translation must also agree with the points of other pairs; pairs removed by
// an imported score or by positions stay out.
AgreeingMatches MatchesThatAgree(const Scene& scene,
                                 const PairGeometries& pairs,
                                 const PairVerificationOptions& verification,
                                 const ModelRefinementOptions& refinement,
                                 const colmap::Reconstruction& model);

// Triangulates what has no point yet, completes and merges tracks. Returns the
// number of observations that the model gained.
size_t Retriangulate(const ModelRefinementOptions& options,
                     const AgreeingMatches& matches,
                     colmap::Reconstruction* model);

// Completes the tracks of a calibrated model and adjusts it again.
void CompleteTracks(const MappingContext& context,
                    const PairGeometries& pairs,
                    ModelInProgress* progress,
                    MappingLog* log);

// Judges the pairs of the images of a model by its poses: those that had left
// become VALID if enough of their matches agree. Pairs with images that the
// model lacks keep their status.
void JudgePairs(const MappingContext& context,
                const colmap::Reconstruction& model,
                PairGeometries* pairs);

}  // namespace dgsfm
