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
  // verified. `conversions`: by what affine maps became `depths`.
  PairGeometries LoadOrVerifyPairs(const Scene& scene,
                                   const KeypointDepthMap& depths,
                                   const AffineDepths& conversions,
                                   std::vector<StageReport>* stages) const;
  void PrintSummary(const Scene& scene,
                    const DepthGlobalMapperResult& result) const;
  void StageModels(const RunFolder& folder, DepthGlobalMapperResult* result);
  void WritePairStatuses(const PairGeometries& pairs) const;

  GlobalDepthMapperOptions options_;
};

}  // namespace dgsfm
