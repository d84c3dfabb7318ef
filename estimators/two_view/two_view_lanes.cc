#include "estimators/two_view/two_view_lanes.h"

namespace dgsfm {

DGSFM_TARGET_CLONES
std::vector<MatchLanes> CreateMatchLanes(const TwoViewData& data) {
  std::vector<MatchLanes> lanes((data.size() + kNumLanes - 1) / kNumLanes);
  for (MatchLanes& group : lanes)
    group.depth1 = group.log_depth2 = Lanes{} + 1.0;
  for (size_t i = 0; i < data.size(); ++i) {
    const TwoViewMatch& match = data[i];
    MatchLanes& group = lanes[i / kNumLanes];
    const int k = static_cast<int>(i % kNumLanes);
    for (int d = 0; d < 2; ++d) {
      group.x1[d][k] = match.x1[d];
      group.x2[d][k] = match.x2[d];
    }
    for (int d = 0; d < 3; ++d) {
      group.covariance1[d][k] = match.covariance1[d];
      group.covariance2[d][k] = match.covariance2[d];
    }
    group.is_match[k] = 1;
    if (!match.HasDepths()) continue;
    group.depth1[k] = match.depth1;
    group.log_depth2[k] = match.depth2;
    group.has_depths[k] = 1;
  }
  for (MatchLanes& group : lanes) group.log_depth2 = Log(group.log_depth2);
  return lanes;
}

}  // namespace dgsfm
