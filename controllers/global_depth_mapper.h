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
  PairGeometries LoadOrVerifyPairs(const Scene& scene,
                                   const KeypointDepthMap& depths,
                                   std::vector<StageReport>* stages);
  PairGeometries Verify(const Scene& scene,
                        const KeypointDepthMap& depths,
                        std::vector<StageReport>* stages) const;
  // Geometries of all pairs of the scene. Throws where one is not stored; those
  // that do not hold any more are verified again.
  PairGeometries CheckedPairs(const Scene& scene,
                              const KeypointDepthMap& depths,
                              const PairGeometries& stored,
                              std::vector<StageReport>* stages) const;
  void StageModels(const RunFolder& folder, DepthGlobalMapperResult* result);
  void WritePairStatuses(const PairGeometries& pairs) const;

  GlobalDepthMapperOptions options_;
};

}  // namespace dgsfm
