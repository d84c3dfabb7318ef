// The controller of depth_global_mapper: from a database to models on disk.

#pragma once

#include "controllers/global_depth_mapper_options.h"
#include "controllers/output_folder.h"
#include "sfm/global_mapping.h"

#include <vector>

namespace dgsfm {

// Maps a database; pairs are verified first where the database has no result.
class GlobalDepthMapper {
 public:
  explicit GlobalDepthMapper(const GlobalDepthMapperOptions& options);

  // Writes models and report. Returns false if no model came out of it (the
  // report then says why); throws std::runtime_error on unusable input.
  bool Run();

 private:
  // Geometries of all pairs of the scene: stored ones that hold, all others
  // verified.
  PairGeometries LoadOrVerifyPairs(const Scene& scene,
                                   const KeypointDepthMap& depths,
                                   std::vector<StageReport>* stages) const;
  void StageModels(const RunFolder& folder,
                   const RigScene& rigs,
                   DepthGlobalMapperResult* result);
  void WritePairStatuses(const PairGeometries& pairs) const;

  GlobalDepthMapperOptions options_;
};

}  // namespace dgsfm
