// The controller of depth_global_mapper: from a database to models on disk.

#pragma once

#include "controllers/global_depth_mapper_options.h"
#include "controllers/output_folder.h"
#include "sfm/global_mapping.h"

#include <string>
#include <utility>
#include <vector>

namespace dgsfm {

// What came out of a run, for messages.
struct GlobalDepthMapperSummary {
  struct Model {
    // Folder of the model.
    std::string path;
    size_t num_images = 0;
    MeasuredUnit unit;
  };
  // Largest first.
  std::vector<Model> models;
  // Name and reason of each image of no model.
  std::vector<std::pair<std::string, std::string>> unregistered_images;
  std::string output_path;

  // What was made, how good it looks and what to look at, in lines.
  std::string text;

  // Why the run failed: there is no model.
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
  // Geometries of all pairs of the scene: stored ones that hold, all others
  // verified.
  PairGeometries LoadOrVerifyPairs(const Scene& scene,
                                   const KeypointDepthMap& depths,
                                   std::vector<StageReport>* stages) const;
  void StageModels(const RunFolder& folder,
                   const RigScene& rigs,
                   DepthGlobalMapperResult* result);
  // The page for the models and the report that were staged.
  void StageReportPage(const RunFolder& folder, size_t num_models) const;
  void WritePairStatuses(const PairGeometries& pairs) const;

  GlobalDepthMapperOptions options_;
};

}  // namespace dgsfm
