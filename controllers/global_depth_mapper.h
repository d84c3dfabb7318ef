// The controllers of depth_geometric_verifier and depth_global_mapper: from a
// database to stored pair geometries, and on to models on disk.

#pragma once

#include "controllers/command_options.h"
#include "sfm/depth_global_mapper.h"

#include <string>

namespace dgsfm {

struct DepthGeometricVerifierOptions {
  std::string database_path;
  PairVerificationOptions verification;
  // Ignore the depth priors: pairs are estimated as without depth.
  bool use_depth = true;
};

struct GlobalDepthMapperOptions {
  std::string database_path;
  // Folder of the images, for the colours of the points; empty = no colours.
  std::string image_path;
  // Existing folder that receives 0/, 1/, ..., report.json and project.ini.
  std::string output_path;
  // File of pair scores, lines "name1 name2 score"; empty = none.
  std::string pair_scores_path;
  DepthGeometricVerifierOptions verifier;
  DepthGlobalMapperOptions mapper;
  // The method and thresholds of the paper.
  bool paper = false;
};

// Binds all options; call before parsing.
void BindOptions(DepthGeometricVerifierOptions* options,
                 CommandOptions* command_options);
void BindOptions(GlobalDepthMapperOptions* options,
                 CommandOptions* command_options);

// Verifies all pairs of the database with depth and stores the result in it.
// Throws std::runtime_error on unusable input; the database is then unchanged.
void VerifyDatabasePairs(const DepthGeometricVerifierOptions& options);

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
  void WriteModels(DepthGlobalMapperResult* result);
  void WriteReport(const Scene& scene,
                   const PairGeometries& pairs,
                   const DepthGlobalMapperResult& result) const;

  GlobalDepthMapperOptions options_;
};

}  // namespace dgsfm
