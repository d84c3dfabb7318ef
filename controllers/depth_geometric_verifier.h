// The controller of depth_geometric_verifier: pairs of a database are verified
// with depth and the result is stored in it.

#pragma once

#include "colmap_ext/database/scene_database.h"
#include "controllers/commands/command_options.h"
#include "controllers/database_pair_verifier.h"
#include "sfm/stage_report.h"
#include "sfm/verification/pair_verification.h"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

struct DepthGeometricVerifierOptions {
  std::string database_path;
  PairVerificationOptions verification;
  // Ignore the depth priors: pairs are estimated as without depth.
  bool use_depth = true;
  // What prior focal lengths of the database are: auto, exif or calibrated, see
  // PriorTrust.
  std::string intrinsics_prior = "auto";
  // Finished pairs are stored about this often [s]: what a run that is broken
  // off loses.
  double checkpoint_interval_s = 5;
  // Verify all pairs again, also those whose stored result still holds.
  bool restart = false;
  // A part of the pairs: shard shard_index of num_shards, whose result goes to
  // the file output_path; the database is not written then, and must not be by
  // others meanwhile. Empty = all pairs, into the database.
  int shard_index = 0;
  int num_shards = 1;
  std::string output_path;

  bool IsShard() const { return !output_path.empty(); }
  SqliteConnection::Mode ReadMode() const {
    return IsShard() ? SqliteConnection::Mode::UNCHANGING
                     : SqliteConnection::Mode::READ_ONLY;
  }

  bool IsValid(std::string* error) const;
};

// Binds all options; call before parsing.
void BindOptions(DepthGeometricVerifierOptions* options,
                 CommandOptions* command_options);
// Binds those of input and estimation.
void BindVerificationOptions(DepthGeometricVerifierOptions* options,
                             CommandOptions* command_options);

// Binds those of estimation that every pair is verified with.
void BindVerification(PairVerificationOptions* options,
                      CommandOptions* command_options);

// All options that change results, with their values: what the fingerprints of
// stored pairs have of them.
std::string VerificationText(PairVerificationOptions options);

// Depths of the key points of the scene; none, with a warning, where there are
// no priors or they are not to be used.
KeypointDepthMap LoadDepths(const DepthGeometricVerifierOptions& options,
                            const Scene& scene,
                            std::vector<StageReport>* stages);

// The scene of the database, or of some of its images, with at most about
// max_num_keypoints matched key points an image, 0 = all, and without matches
// and their source.
Scene LoadScene(const DepthGeometricVerifierOptions& options,
                int max_num_keypoints,
                const std::optional<ImageNames>& names,
                std::vector<StageReport>* stages);

// The verifier of a database with these options.
DatabasePairVerifier CreatePairVerifier(
    const DepthGeometricVerifierOptions& options,
    const Scene& scene,
    const KeypointDepthMap& depths);

// Takes finished pairs.
using PairStore = std::function<void(const PairGeometries&)>;

// Verifies pairs and stores those that are finished about every
// checkpoint_interval_s, and if the run is cancelled.
void VerifyAndStore(const DepthGeometricVerifierOptions& options,
                    const DatabasePairVerifier::PairSizes& pairs,
                    const PairStore& store,
                    DatabasePairVerifier* verifier);

struct VerificationSummary {
  // Over all pairs of the database.
  PairTotals totals;
  // Pairs whose stored result still held.
  size_t num_kept = 0;
  // Stored results that did not hold any more, or whose pair is gone.
  size_t num_deleted = 0;

  size_t NumPairs() const;
  size_t NumValidPairs() const;
};

// Verifies all pairs of the database with depth and stores the result in it.
//
// A run that was broken off goes on where it stopped: a pair whose stored
// result has the fingerprint of what it is verified from now (matches, points,
// depths, cameras, options) is done. Results that do not hold any more are
// deleted first, so that the database never holds those of other options. What
// is stored at the end depends neither on threads nor on interruptions.
//
// The longest pairs are verified first. Matches are read and results written
// on the way, so that a pair costs some 50 bytes of memory.
//
// Throws std::runtime_error on unusable input, and Cancelled; pairs that were
// stored until then, in the second case all that were finished, stay.
VerificationSummary VerifyDatabasePairs(
    const DepthGeometricVerifierOptions& options);

}  // namespace dgsfm
