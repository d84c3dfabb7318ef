#include "sfm/verification/depth_reliability.h"

#include <algorithm>
#include <map>
#include <set>

namespace dgsfm {

namespace {

// Standard deviation of the log scale ratio up to which depth maps confirm
// each other. Ten per cent of noise at a hundred points give 0.02, unrelated
// maps 0.1.
constexpr double kMaxLogScaleStddev = 0.05;
constexpr int kMinNumContradictions = 2;

bool Confirms(const PairGeometry& pair) {
  return pair.status == PairStatus::VALID && pair.has_scale &&
         pair.log_scale_stddev > 0 &&
         pair.log_scale_stddev < kMaxLogScaleStddev;
}

}  // namespace

std::vector<colmap::image_t> FindUnreliableDepths(const PairGeometries& pairs) {
  using Images = std::set<colmap::image_t>;
  std::map<colmap::image_t, Images> confirmations;
  std::map<colmap::image_t, Images> contradictions;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (Confirms(pair)) {
      confirmations[image_id1].insert(image_id2);
      confirmations[image_id2].insert(image_id1);
    } else if (pair.status == PairStatus::DEPTH_INCONSISTENT) {
      contradictions[image_id1].insert(image_id2);
      contradictions[image_id2].insert(image_id1);
    }
  }
  std::vector<colmap::image_t> doubtful;
  for (const auto& [image_id, others] : contradictions) {
    if (int(others.size()) >= kMinNumContradictions) {
      doubtful.push_back(image_id);
    }
  }
  // One at a time: a bad map also contradicts good ones, which are cleared once
  // it is gone.
  Images unreliable;
  while (true) {
    int worst_excess = 0;
    colmap::image_t worst = colmap::kInvalidImageId;
    for (const auto& [image_id, others] : contradictions) {
      const int excess =
          int(others.size()) - int(confirmations[image_id].size());
      if (int(others.size()) >= kMinNumContradictions &&
          excess > worst_excess) {
        worst_excess = excess;
        worst = image_id;
      }
    }
    if (worst == colmap::kInvalidImageId) break;
    unreliable.insert(worst);
    for (const colmap::image_t other : contradictions[worst]) {
      contradictions[other].erase(worst);
    }
    contradictions.erase(worst);
  }
  // Where all maps are bad, the last ones are left without contradictions, and
  // without any that confirms them.
  for (const colmap::image_t image_id : doubtful) {
    const Images& others = confirmations[image_id];
    if (std::includes(unreliable.begin(),
                      unreliable.end(),
                      others.begin(),
                      others.end())) {
      unreliable.insert(image_id);
    }
  }
  return {unreliable.begin(), unreliable.end()};
}

}  // namespace dgsfm
