#include "sfm/view_graph/pair_filters.h"

#include "estimators/option_check.h"
#include "sfm/view_graph/view_graph.h"

#include <set>
#include <vector>

namespace dgsfm {

namespace {

std::vector<colmap::image_t> ImagesOfValidPairs(const PairGeometries& pairs) {
  std::set<colmap::image_t> image_ids;
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    image_ids.insert({image_id1, image_id2});
  }
  return {image_ids.begin(), image_ids.end()};
}

}  // namespace

bool ViewGraphFilterOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Within("min_pair_score", min_pair_score, 0, 1)
      .Within("min_triplet_support", min_triplet_support, 0, 1)
      .AreKept();
}

size_t FilterByPairScore(const ViewGraphFilterOptions& options,
                         const PairScores& scores,
                         PairGeometries* pairs) {
  size_t num_filtered = 0;
  for (auto& [pair_id, pair] : *pairs) {
    const auto it = scores.find(pair_id);
    if (pair.status != PairStatus::VALID || it == scores.end() ||
        it->second > options.min_pair_score) {
      continue;
    }
    pair.Judge(PairStage::VIEW_GRAPH_FILTER, PairStatus::LOW_PAIR_SCORE);
    ++num_filtered;
  }
  return num_filtered;
}

size_t FilterByTripletSupport(const ViewGraphFilterOptions& options,
                              PairGeometries* pairs) {
  if (options.min_triplet_support <= 0) return 0;
  const ImageIndex index(ImagesOfValidPairs(*pairs));
  const std::vector<IndexedPair> valid_pairs = ValidPairs(index, pairs);
  std::vector<GraphEdge> edges;
  std::vector<double> counts;
  for (const IndexedPair& indexed : valid_pairs) {
    edges.emplace_back(indexed.image1, indexed.image2);
    counts.push_back(double(indexed.pair->NumInliers()));
  }
  const std::vector<double> support =
      TripletSupport(index.Size(), edges, counts);
  size_t num_filtered = 0;
  for (size_t i = 0; i < edges.size(); ++i) {
    // Edges in no triplet (support -1) have no evidence against them.
    if (support[i] < 0 || support[i] > options.min_triplet_support) continue;
    valid_pairs[i].pair->Judge(PairStage::VIEW_GRAPH_FILTER,
                               PairStatus::LOW_TRIPLET_SUPPORT);
    ++num_filtered;
  }
  return num_filtered;
}

std::map<PairStatus, size_t> ApplyPairFilters(
    const ViewGraphFilterOptions& options,
    const Scene& /*scene*/,
    const PairScores& scores,
    PairGeometries* pairs) {
  return {
      {PairStatus::LOW_PAIR_SCORE, FilterByPairScore(options, scores, pairs)},
      {PairStatus::LOW_TRIPLET_SUPPORT, FilterByTripletSupport(options, pairs)},
  };
}

}  // namespace dgsfm
