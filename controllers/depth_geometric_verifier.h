// The controller of depth_geometric_verifier: pairs of a database are verified
// with depth and the result is stored in it.

#pragma once

#include "controllers/command_options.h"
#include "sfm/pair_verification.h"
#include "sfm/stage_report.h"

#include <string>
#include <vector>

namespace dgsfm {

struct DepthGeometricVerifierOptions {
  std::string database_path;
  PairVerificationOptions verification;
  // Ignore the depth priors: pairs are estimated as without depth.
  bool use_depth = true;
};

// Binds all options; call before parsing.
void BindOptions(DepthGeometricVerifierOptions* options,
                 CommandOptions* command_options);

// Key point depths of the database; none, with a warning, where there are no
// priors or they are not to be used.
KeypointDepthMap LoadDepths(const DepthGeometricVerifierOptions& options,
                            std::vector<StageReport>* stages);

// The scene of the database.
Scene LoadScene(const DepthGeometricVerifierOptions& options,
                std::vector<StageReport>* stages);

// Verifies all pairs of a scene and shows the progress.
PairGeometries VerifyScenePairs(const Scene& scene,
                                const KeypointDepthMap& depths,
                                const PairVerificationOptions& options,
                                std::vector<StageReport>* stages);

// Verifies all pairs of the database with depth and stores the result in it.
// Throws std::runtime_error on unusable input; the database is then unchanged.
void VerifyDatabasePairs(const DepthGeometricVerifierOptions& options);

}  // namespace dgsfm
