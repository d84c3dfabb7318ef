// A number that shows whether a stored pair geometry still holds.

#pragma once

#include "sfm/verification/pair_verification.h"

#include <cstdint>
#include <string>

namespace dgsfm {

// Version of the method of VerifyPair(), which fingerprints have in them.
uint32_t PairMethodVersion();

// 64-bit FNV-1a hash of all that VerifyPair() takes for a pair: its matches
// with their points and depths, cameras, priors of focal lengths, and the
// options as `options_text`; and of the version of its method.
uint64_t PairFingerprint(const PairImage& image1,
                         const PairImage& image2,
                         const colmap::FeatureMatches& matches,
                         const std::string& options_text);

}  // namespace dgsfm
