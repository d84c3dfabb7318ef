#include "sfm/joining/part_joining.h"

#include "estimators/averaging/similarity_averaging.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include <Eigen/Cholesky>
#include <glog/logging.h>

namespace dgsfm {

namespace {

using PartImage = PartModel::PartImage;

// Shared points that are used of two parts: more make the similarity no better.
constexpr size_t kMaxNumSharedPoints = 2000;
// Positions of a part that leave its scale less certain hold nothing [log].
constexpr double kMaxLogScaleStddev = 0.2;
// Standard deviations of rotation and scale by positions count so many times:
// those between parts are by what is tolerated, and far better. A street of ten
// parts with positions of 2 m is off by 0.35 m then (0.56 m without positions);
// by 2 parts contradict each other, by 10 it is off by 0.39 m.
constexpr double kPositionStddevFactor = 5;

// Two parts that share images.
struct PartPair {
  int part1 = 0;
  int part2 = 0;
  std::vector<colmap::image_t> shared;
  // Between them alone; nothing if there is none that most points agree with.
  std::optional<RelativeSimilarity> similarity;
};

double MedianDepth(const PartModel& part, const PartImage& image) {
  std::vector<double> depths;
  for (const PartModel::Observation& observation : image.observations) {
    depths.push_back(
        (image.cam_from_part * part.points[observation.point]).z());
  }
  return depths.empty() ? 0 : Median(std::move(depths));
}

// Points and centres of shared images in both frames, weighted by the inverse
// of their distance from the camera, as their errors grow with it.
std::vector<PositionMatch> SharedPositions(const PartModel& part1,
                                           const PartModel& part2,
                                           const PartPair& pair) {
  std::map<std::pair<uint32_t, uint32_t>, double> distances;
  std::vector<PositionMatch> centers;
  for (const colmap::image_t image_id : pair.shared) {
    const PartImage& image1 = part1.images.at(image_id);
    const PartImage& image2 = part2.images.at(image_id);
    const Eigen::Vector3d center2 = image2.cam_from_part.TargetOriginInSource();
    const double depth = MedianDepth(part2, image2);
    if (depth > 0) {
      centers.push_back({image1.cam_from_part.TargetOriginInSource(),
                         center2,
                         Eigen::Matrix3d::Identity() / depth});
    }
    for (const auto& points : SharedPoints(image1, image2)) {
      const double distance = (part2.points[points.second] - center2).norm();
      if (distance > 0) distances[points] = distance;
    }
  }
  std::vector<PositionMatch> matches;
  const size_t step = distances.size() / kMaxNumSharedPoints + 1;
  size_t i = 0;
  for (const auto& [points, distance] : distances) {
    if (i++ % step != 0) continue;
    matches.push_back({part1.points[points.first],
                       part2.points[points.second],
                       Eigen::Matrix3d::Identity() / distance});
  }
  matches.insert(matches.end(), centers.begin(), centers.end());
  return matches;
}

// The images that two parts have in the same place, in a frame of both.
size_t CountAgreeing(const PartJoiningOptions& options,
                     const std::vector<PartModel>& parts,
                     const PartPair& pair,
                     const Similarity3d& frame_from_1,
                     const Similarity3d& frame_from_2) {
  size_t num_agreeing = 0;
  for (const colmap::image_t image_id : pair.shared) {
    const PartImage& image1 = parts[pair.part1].images.at(image_id);
    const PartImage& image2 = parts[pair.part2].images.at(image_id);
    const Eigen::Quaterniond rotation1 =
        image1.cam_from_part.rotation * frame_from_1.rotation.conjugate();
    const Eigen::Quaterniond rotation2 =
        image2.cam_from_part.rotation * frame_from_2.rotation.conjugate();
    const double distance =
        (frame_from_1 * image1.cam_from_part.TargetOriginInSource() -
         frame_from_2 * image2.cam_from_part.TargetOriginInSource())
            .norm();
    num_agreeing += rotation1.angularDistance(rotation2) <=
                        options.max_rotation_error_deg * M_PI / 180 &&
                    distance <= options.max_center_error * frame_from_2.scale *
                                    MedianDepth(parts[pair.part2], image2);
  }
  return num_agreeing;
}

std::optional<RelativeSimilarity> AlignParts(
    const PartJoiningOptions& options,
    const std::vector<PartModel>& parts,
    const PartPair& pair) {
  const auto matches =
      SharedPositions(parts[pair.part1], parts[pair.part2], pair);
  const auto alignment = AlignPositions({}, matches, std::nullopt);
  if (!alignment) return std::nullopt;
  RelativeSimilarity similarity;
  similarity.node1 = pair.part1;
  similarity.node2 = pair.part2;
  similarity.node2_from_node1 = alignment->target_from_source;
  if (double(CountAgreeing(
          options, parts, pair, similarity.node2_from_node1, Similarity3d())) <
      options.min_agreeing_share * double(pair.shared.size())) {
    return std::nullopt;
  }
  // A part is bent by more than the noise of its points: what is tolerated is
  // where the loss gives an edge up.
  std::vector<double> depths;
  for (const colmap::image_t image_id : pair.shared) {
    const PartModel& part1 = parts[pair.part1];
    depths.push_back(MedianDepth(part1, part1.images.at(image_id)));
  }
  const double loss_scale = options.averaging.loss_scale;
  similarity.rotation_stddev_rad =
      options.max_rotation_error_deg * M_PI / 180 / loss_scale;
  similarity.log_scale_stddev = options.max_center_error / loss_scale;
  similarity.anchor_stddev =
      std::max(Median(std::move(depths)), 1e-12) * similarity.log_scale_stddev;
  for (const PositionMatch& match : matches) {
    similarity.anchor_in_1 += match.source / double(matches.size());
  }
  return similarity;
}

// The frame of the positions is the node after those of the parts.
std::optional<RelativeSimilarity> AlignToPositions(const PosePriors& positions,
                                                   const PartModel& part,
                                                   int index,
                                                   int node_of_positions) {
  std::vector<PositionMatch> matches;
  std::vector<double> stddevs;
  for (const auto& [image_id, image] : part.images) {
    const auto prior = positions.find(image_id);
    if (prior == positions.end() || !prior->second.HasPosition()) continue;
    const Eigen::Matrix3d& covariance = prior->second.covariance;
    const Eigen::Matrix3d lower = covariance.llt().matrixL();
    matches.push_back({image.cam_from_part.TargetOriginInSource(),
                       prior->second.position,
                       lower.inverse()});
    stddevs.push_back(std::sqrt(covariance.trace() / 3));
  }
  const auto alignment = AlignPositions({}, matches, std::nullopt);
  if (!alignment || !(alignment->log_scale_stddev <= kMaxLogScaleStddev)) {
    return std::nullopt;
  }
  RelativeSimilarity similarity;
  similarity.node1 = index;
  similarity.node2 = node_of_positions;
  similarity.node2_from_node1 = alignment->target_from_source;
  similarity.rotation_stddev_rad =
      kPositionStddevFactor * alignment->rotation_stddev_rad;
  similarity.log_scale_stddev =
      kPositionStddevFactor * alignment->log_scale_stddev;
  similarity.anchor_stddev = std::max(1.0, alignment->spread) *
                             Median(std::move(stddevs)) /
                             (std::sqrt(double(alignment->num_inliers)) *
                              alignment->target_from_source.scale);
  for (const PositionMatch& match : matches) {
    similarity.anchor_in_1 += match.source / double(matches.size());
  }
  return similarity;
}

std::vector<PartPair> FindPairs(const PartJoiningOptions& options,
                                const std::vector<PartModel>& parts) {
  std::map<colmap::image_t, std::vector<int>> parts_of_image;
  for (size_t i = 0; i < parts.size(); ++i) {
    for (const auto& [image_id, image] : parts[i].images) {
      parts_of_image[image_id].push_back(int(i));
    }
  }
  std::map<std::pair<int, int>, std::vector<colmap::image_t>> shared;
  for (const auto& [image_id, indices] : parts_of_image) {
    for (size_t i = 0; i < indices.size(); ++i) {
      for (size_t j = i + 1; j < indices.size(); ++j) {
        shared[{indices[i], indices[j]}].push_back(image_id);
      }
    }
  }
  std::vector<PartPair> pairs;
  for (const auto& [indices, image_ids] : shared) {
    if (image_ids.size() < size_t(options.min_num_shared_images)) continue;
    PartPair pair = {indices.first, indices.second, image_ids, std::nullopt};
    pair.similarity = AlignParts(options, parts, pair);
    pairs.push_back(std::move(pair));
  }
  return pairs;
}

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

bool PartJoiningOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("min_num_shared_images", min_num_shared_images, 3)
      .Within("min_agreeing_share", min_agreeing_share, 0, 1)
      .Above("max_rotation_error_deg", max_rotation_error_deg, 0)
      .Above("max_center_error", max_center_error, 0)
      .Valid(averaging)
      .AreKept();
}

PartGroups GroupParts(const PartJoiningOptions& options,
                      const PosePriors& positions,
                      const std::vector<PartModel>& parts) {
  const std::vector<PartPair> pairs = FindPairs(options, parts);
  PartGroups by_parts = GroupBySimilarities(options, parts, {}, pairs);
  std::vector<RelativeSimilarity> positions_from_parts;
  for (size_t i = 0; i < parts.size(); ++i) {
    if (const auto similarity =
            AlignToPositions(positions, parts[i], int(i), int(parts.size()))) {
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
