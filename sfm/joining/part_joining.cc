#include "sfm/joining/part_joining.h"

#include "estimators/median.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Each part has a scale of its own, from its depth maps, positions or rigs; the
// median is more accurate than any.
void UseMedianScale(std::vector<Similarity3d>* group_from_part) {
  std::vector<double> log_scales;
  for (const Similarity3d& similarity : *group_from_part) {
    log_scales.push_back(std::log(similarity.scale));
  }
  const double factor = std::exp(-Median(std::move(log_scales)));
  for (Similarity3d& similarity : *group_from_part) {
    similarity.scale *= factor;
    similarity.translation *= factor;
  }
}

// Frames of the parts of a group by similarities between its nodes; the last
// node is the frame of positions, if these have any. Nothing if they cannot be
// averaged.
std::optional<std::vector<Similarity3d>> AverageFrames(
    const PartJoiningOptions& options,
    const std::vector<RelativeSimilarity>& similarities,
    int num_parts,
    int fixed_part) {
  const bool has_positions = std::any_of(
      similarities.begin(), similarities.end(), [&](const auto& similarity) {
        return similarity.node2 == num_parts;
      });
  std::vector<Similarity3d> group_from_node(num_parts + has_positions);
  if (!similarities.empty() &&
      !AverageSimilarities(num_parts + has_positions,
                           similarities,
                           has_positions ? num_parts : fixed_part,
                           options.averaging,
                           &group_from_node)) {
    return std::nullopt;
  }
  group_from_node.resize(num_parts);
  return group_from_node;
}

// Groups of the parts that similarities connect, without those left out.
std::vector<PartGroup> AverageGroups(
    const PartJoiningOptions& options,
    const std::vector<PartModel>& parts,
    const std::vector<RelativeSimilarity>& positions_from_parts,
    const std::vector<PartPair>& pairs,
    const std::set<int>& left_out) {
  std::vector<GraphEdge> edges;
  std::vector<const PartPair*> joining;
  for (const PartPair& pair : pairs) {
    if (!pair.similarity || left_out.count(pair.part1) > 0 ||
        left_out.count(pair.part2) > 0) {
      continue;
    }
    edges.emplace_back(pair.part1, pair.part2);
    joining.push_back(&pair);
  }
  const std::vector<int> component =
      ConnectedComponents(int(parts.size()), edges);
  std::map<int, PartGroup> groups;
  std::vector<int> index(parts.size());
  for (size_t i = 0; i < parts.size(); ++i) {
    PartGroup& group = groups[component[i]];
    index[i] = int(group.parts.size());
    group.parts.push_back(int(i));
  }
  std::vector<PartGroup> averaged;
  for (auto& [id, group] : groups) {
    std::vector<RelativeSimilarity> similarities;
    for (const PartPair* pair : joining) {
      if (component[pair->part1] != id) continue;
      similarities.push_back(*pair->similarity);
      similarities.back().node1 = index[pair->part1];
      similarities.back().node2 = index[pair->part2];
    }
    for (const RelativeSimilarity& similarity : positions_from_parts) {
      if (group.parts.size() < 2 || component[similarity.node1] != id) continue;
      similarities.push_back(similarity);
      similarities.back().node1 = index[similarity.node1];
      similarities.back().node2 = int(group.parts.size());
    }
    const auto largest = std::max_element(
        group.parts.begin(), group.parts.end(), [&](int i, int j) {
          return parts[i].images.size() < parts[j].images.size();
        });
    group.group_from_part.assign(group.parts.size(), Similarity3d());
    if (const auto frames = AverageFrames(options,
                                          similarities,
                                          int(group.parts.size()),
                                          int(largest - group.parts.begin()))) {
      group.group_from_part = *frames;
    } else {
      LOG(ERROR) << "The similarities of " << group.parts.size()
                 << " parts cannot be averaged";
    }
    UseMedianScale(&group.group_from_part);
    averaged.push_back(std::move(group));
  }
  return averaged;
}

// Images that a part shares, and those of them that contradict other parts.
struct Contradiction {
  size_t num_shared = 0;
  size_t num_contradicting = 0;

  double Share() const {
    return num_shared == 0 ? 0 : double(num_contradicting) / double(num_shared);
  }
};

// Contradictions of the parts in groups, by pairs whose images do not agree.
std::map<int, Contradiction> FindContradictions(
    const PartJoiningOptions& options,
    const std::vector<PartModel>& parts,
    const std::vector<PartPair>& pairs,
    const std::vector<PartGroup>& groups,
    const std::set<int>& left_out) {
  std::vector<int> group_of_part(parts.size());
  std::vector<Similarity3d> similarities(parts.size());
  for (size_t i = 0; i < groups.size(); ++i) {
    for (size_t j = 0; j < groups[i].parts.size(); ++j) {
      group_of_part[groups[i].parts[j]] = int(i);
      similarities[groups[i].parts[j]] = groups[i].group_from_part[j];
    }
  }
  std::map<int, Contradiction> contradictions;
  bool is_any = false;
  for (const PartPair& pair : pairs) {
    if (left_out.count(pair.part1) > 0 || left_out.count(pair.part2) > 0) {
      continue;
    }
    const bool is_joined =
        group_of_part[pair.part1] == group_of_part[pair.part2];
    const size_t num_agreeing = is_joined
                                    ? CountAgreeing(options,
                                                    parts,
                                                    pair,
                                                    similarities[pair.part1],
                                                    similarities[pair.part2])
                                    : 0;
    const bool contradicts =
        double(num_agreeing) <
        options.min_agreeing_share * double(pair.shared.size());
    is_any |= contradicts && is_joined;
    for (const int part : {pair.part1, pair.part2}) {
      Contradiction& contradiction = contradictions[part];
      contradiction.num_shared += pair.shared.size();
      if (contradicts) {
        contradiction.num_contradicting += pair.shared.size() - num_agreeing;
      }
    }
  }
  if (!is_any) contradictions.clear();
  return contradictions;
}

std::string DescribePair(const std::vector<PartModel>& parts,
                         const PartPair& pair) {
  return parts[pair.part1].name + " and " + parts[pair.part2].name + " share " +
         std::to_string(pair.shared.size()) +
         " images, but contradict each other: they stay models of their own";
}

// Pairs of parts that share images and are in different groups.
std::vector<std::string> DescribeContradictions(
    const std::vector<PartModel>& parts,
    const std::vector<PartPair>& pairs,
    const std::vector<PartGroup>& groups) {
  std::map<int, int> group_of_part;
  for (size_t i = 0; i < groups.size(); ++i) {
    for (const int part : groups[i].parts) group_of_part[part] = int(i);
  }
  std::vector<std::string> texts;
  for (const PartPair& pair : pairs) {
    if (group_of_part[pair.part1] == group_of_part[pair.part2]) continue;
    texts.push_back(DescribePair(parts, pair));
  }
  return texts;
}

size_t NumImages(const std::vector<PartModel>& parts, const PartGroup& group) {
  std::set<colmap::image_t> image_ids;
  for (const int part : group.parts) {
    for (const auto& [image_id, image] : parts[part].images) {
      image_ids.insert(image_id);
    }
  }
  return image_ids.size();
}

PartGroups GroupBySimilarities(
    const PartJoiningOptions& options,
    const std::vector<PartModel>& parts,
    const std::vector<RelativeSimilarity>& positions_from_parts,
    const std::vector<PartPair>& pairs) {
  std::set<int> left_out;
  PartGroups result;
  while (true) {
    result.groups =
        AverageGroups(options, parts, positions_from_parts, pairs, left_out);
    const auto contradictions =
        FindContradictions(options, parts, pairs, result.groups, left_out);
    int worst = -1;
    double worst_share = 0;
    for (const auto& [part, contradiction] : contradictions) {
      if (contradiction.Share() > worst_share) {
        worst = part;
        worst_share = contradiction.Share();
      }
    }
    if (worst < 0) break;
    left_out.insert(worst);
  }
  result.contradictions = DescribeContradictions(parts, pairs, result.groups);
  std::stable_sort(result.groups.begin(),
                   result.groups.end(),
                   [&](const PartGroup& a, const PartGroup& b) {
                     return NumImages(parts, a) > NumImages(parts, b);
                   });
  return result;
}

}  // namespace

PartGroups GroupParts(const PartJoiningOptions& options,
                      const PosePriors& positions,
                      const std::vector<PartModel>& parts) {
  const std::vector<PartPair> pairs = FindPartPairs(options, parts);
  PartGroups by_parts = GroupBySimilarities(options, parts, {}, pairs);
  std::vector<RelativeSimilarity> positions_from_parts;
  for (size_t i = 0; i < parts.size(); ++i) {
    if (const auto similarity = AlignPartToPositions(
            positions, parts[i], int(i), int(parts.size()))) {
      positions_from_parts.push_back(*similarity);
    }
  }
  if (positions_from_parts.empty()) return by_parts;
  PartGroups by_positions =
      GroupBySimilarities(options, parts, positions_from_parts, pairs);
  // Wrong positions must not part what belongs together.
  return by_positions.groups.size() > by_parts.groups.size()
             ? std::move(by_parts)
             : std::move(by_positions);
}

}  // namespace dgsfm
