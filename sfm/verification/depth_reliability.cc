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

using Images = std::set<colmap::image_t>;
using Links = std::map<colmap::image_t, Images>;

void AddLink(colmap::image_pair_t pair_id, Links* links) {
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  (*links)[image_id1].insert(image_id2);
  (*links)[image_id2].insert(image_id1);
}

const Images& LinkedTo(const Links& links, colmap::image_t image_id) {
  static const Images none;
  const auto it = links.find(image_id);
  return it == links.end() ? none : it->second;
}

// Maps that more others contradict than confirm. One at a time: a bad map also
// contradicts good ones, which are cleared once it is gone.
Images TakeOutWorst(const Links& confirmations, Links contradictions) {
  Images taken;
  while (true) {
    int worst_excess = 0;
    colmap::image_t worst = colmap::kInvalidImageId;
    for (const auto& [image_id, others] : contradictions) {
      const int excess =
          int(others.size()) - int(LinkedTo(confirmations, image_id).size());
      if (int(others.size()) >= kMinNumContradictions &&
          excess > worst_excess) {
        worst_excess = excess;
        worst = image_id;
      }
    }
    if (worst == colmap::kInvalidImageId) return taken;
    taken.insert(worst);
    for (const colmap::image_t other : contradictions[worst]) {
      contradictions[other].erase(worst);
    }
    contradictions.erase(worst);
  }
}

}  // namespace

std::vector<colmap::image_t> FindUnreliableDepths(const PairGeometries& pairs) {
  Links confirmations;
  // Valid pairs with a scale, well-determined or not.
  Links agreements;
  Links contradictions;
  for (const auto& [pair_id, pair] : pairs) {
    if (Confirms(pair)) AddLink(pair_id, &confirmations);
    if (pair.status == PairStatus::VALID && pair.has_scale) {
      AddLink(pair_id, &agreements);
    } else if (pair.status == PairStatus::DEPTH_INCONSISTENT) {
      AddLink(pair_id, &contradictions);
    }
  }
  const Images taken = TakeOutWorst(confirmations, contradictions);
  const auto num_left = [&taken](const Images& images) {
    return std::count_if(images.begin(), images.end(), [&](auto image_id) {
      return taken.count(image_id) == 0;
    });
  };
  // Where all maps are bad, the last ones are left without contradictions, but
  // next to none agrees with them either.
  Images unreliable = taken;
  for (const auto& [image_id, others] : contradictions) {
    if (int(others.size()) >= kMinNumContradictions &&
        num_left(LinkedTo(confirmations, image_id)) == 0 &&
        num_left(LinkedTo(agreements, image_id)) < int(others.size())) {
      unreliable.insert(image_id);
    }
  }
  return {unreliable.begin(), unreliable.end()};
}

}  // namespace dgsfm
