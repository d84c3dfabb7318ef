// The controller of depth_global_mapper: from a database to models on disk.

#pragma once

#include "controllers/global_depth_mapper_options.h"
#include "controllers/output_folder.h"
#include "controllers/pose_prior_loader.h"
#include "controllers/relative_depth_stage.h"
#include "sfm/global_mapping.h"

#include <string>
#include <vector>

namespace dgsfm {

// What came out of a run, for messages.
struct GlobalDepthMapperSummary {
  // Folders of the models, largest first.
  std::vector<std::string> model_paths;
  std::string output_path;

  // What was made, how good it looks and what to look at, in lines.
  std::string text;

  // The message of a run without any model.
  std::string FailureText() const;
};

// Maps a database; pairs are verified first where the database has no result.
class GlobalDepthMapper {
 public:
  explicit GlobalDepthMapper(const GlobalDepthMapperOptions& options);

  // Writes models, report and its page. Where no model came out of it, the
  // report has the reason. Throws std::runtime_error on unusable input.
  GlobalDepthMapperSummary Run();

 private:
  // What a run reads before it verifies pairs.
  struct MapperInput {
    Scene scene;
    LoadedPosePriors pose_priors;
    KeypointDepthMap depths;
    // Maps of unknown scale and shift as they were imported.
    KeypointDepthMap affine_depths;
    RelativeDepths relative;
    PairScores scores;
  };

  // The scene's matches are read through the scene, which stays where it is.
  void LoadInput(MapperInput* input, std::vector<StageReport>* stages) const;
  void PredictMemory(const Scene& scene,
                     const PairGeometries& pairs,
                     std::vector<StageReport>* stages) const;
  // Geometries of all pairs of the scene: stored ones that hold, all others
  // verified and stored, so that a run that is broken off goes on from there.
  // `conversions`: by what affine maps became `depths`.
  PairGeometries LoadOrVerifyPairs(const Scene& scene,
                                   const KeypointDepthMap& depths,
                                   const AffineDepths& conversions,
                                   std::vector<StageReport>* stages) const;
  // Replaces stale geometries of the database; empty if it is not to be written
  // or cannot be.
  PairStore OpenPairStore(const std::vector<colmap::image_pair_t>& stale) const;
  void StageModels(const RunFolder& folder, DepthGlobalMapperResult* result);
  // The page for the models and the report that were staged.
  void StageReportPage(const RunFolder& folder, size_t num_models) const;
  void WritePairStatuses(const PairGeometries& pairs) const;

  GlobalDepthMapperOptions options_;
};

}  // namespace dgsfm
