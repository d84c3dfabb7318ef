#include "sfm/view_graph/component_averaging.h"

#include "estimators/averaging/graph.h"
#include "estimators/averaging/group_turns.h"
#include "estimators/median.h"
#include "estimators/option_check.h"
#include "sfm/view_graph/missing_matches.h"
#include "sfm/view_graph/pair_evidence.h"
#include "sfm/view_graph/rotation_nodes.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Fewer strong pairs among the outliers are accidents.
constexpr double kStrongProbability = 0.9;
constexpr int kMinNumStrongOutliers = 3;
// Missing matches below this are within what true pairs show [nat].
constexpr double kMaxMissingMatches = 12;
// Cost over that of the average, with and without missing matches, up to which
// rotations may take out more than the average does. On photos, those that take
// out true pairs come to 0.33 and 3.0.
constexpr double kMaxCostRatio = 0.3;
constexpr double kMaxOutlierCostRatio = 3;
// Inliers of look-alikes have one cause, which pairs share: their evidence
// counts less than that of missing matches.
constexpr double kOutlierCostFactor = 0.25;

// Rotations of the images and the pairs that are off.
struct RotationAverage {
  std::vector<Eigen::Quaterniond> cam_from_world;
  std::vector<char> is_outlier;
};

double MaxRotationErrorRad(const ComponentAveragingOptions& options) {
  return options.max_rotation_error_deg * M_PI / 180;
}

// The rotation of a pair between its nodes.
RelativeRotation RelativeRotationOf(const RotationNodes& nodes,
                                    const IndexedPair& indexed) {
  const auto& [image1, image2, pair] = indexed;
  RelativeRotation relative;
  relative.node1 = nodes.node_of_image[image1];
  relative.node2 = nodes.node_of_image[image2];
  relative.cam2_from_cam1 = nodes.cam_from_node[image2].conjugate() *
                            pair->cam2_from_cam1.rotation *
                            nodes.cam_from_node[image1];
  relative.weight = PairEvidence(*pair);
  return relative;
}

// The rotations of the pairs between different nodes.
std::vector<RelativeRotation> RelativeRotationsOf(
    const RotationNodes& nodes, const std::vector<IndexedPair>& valid_pairs) {
  std::vector<RelativeRotation> relative_rotations;
  for (const IndexedPair& indexed : valid_pairs) {
    const RelativeRotation relative = RelativeRotationOf(nodes, indexed);
    if (relative.node1 == relative.node2) continue;
    relative_rotations.push_back(relative);
  }
  return relative_rotations;
}

RotationAverage AverageOf(const ComponentAveragingOptions& options,
                          const std::vector<IndexedPair>& valid_pairs,
                          std::vector<Eigen::Quaterniond> cam_from_world) {
  RotationAverage average;
  for (const auto& [image1, image2, pair] : valid_pairs) {
    const Eigen::Quaterniond predicted =
        cam_from_world[image2] * cam_from_world[image1].conjugate();
    average.is_outlier.push_back(
        predicted.angularDistance(pair->cam2_from_cam1.rotation) >
        MaxRotationErrorRad(options));
  }
  average.cam_from_world = std::move(cam_from_world);
  return average;
}

std::optional<RotationAverage> AverageRotationsFrom(
    const ComponentAveragingOptions& options,
    const RotationNodes& nodes,
    const std::vector<IndexedPair>& valid_pairs,
    const std::vector<Eigen::Quaterniond>& start) {
  std::vector<Eigen::Quaterniond> node_from_world = nodes.NodeFromWorld(start);
  if (nodes.num_nodes == 1) {
    node_from_world.assign(1, Eigen::Quaterniond::Identity());
  } else if (!AverageRotations(nodes.num_nodes,
                               RelativeRotationsOf(nodes, valid_pairs),
                               /*fixed_node=*/0,
                               options.rotation_averaging,
                               &node_from_world)) {
    return std::nullopt;
  }
  return AverageOf(options, valid_pairs, nodes.CamFromWorld(node_from_world));
}

int CountStrongOutliers(const RotationAverage& average,
                        const std::vector<IndexedPair>& valid_pairs) {
  int num_strong = 0;
  for (size_t i = 0; i < valid_pairs.size(); ++i) {
    num_strong += average.is_outlier[i] &&
                  PairProbability(*valid_pairs[i].pair) >= kStrongProbability;
  }
  return num_strong;
}

// Images that follow each other by name, or with one in between; the smaller
// index first.
std::set<std::pair<int, int>> ConsecutiveImages(const Scene& scene,
                                                const ImageIndex& index) {
  std::vector<std::pair<std::string, int>> names;
  for (int i = 0; i < index.Size(); ++i) {
    names.emplace_back(scene.images.at(index.IdOf(i)).Name(), i);
  }
  std::sort(names.begin(), names.end());
  std::set<std::pair<int, int>> consecutive;
  for (size_t k = 1; k < names.size(); ++k) {
    for (const size_t step : {1, 2}) {
      if (step > k) continue;
      consecutive.insert(std::minmax(names[k - step].second, names[k].second));
    }
  }
  return consecutive;
}

// The pairs between different nodes, each with the evidence of its inliers for
// it and that of missing matches against it. Photos are mostly taken next to
// those before and after them: the evidence of such pairs counts in full.
std::vector<JudgedRotation> JudgeRotations(
    const Scene& scene,
    const ImageIndex& index,
    const RotationNodes& nodes,
    const std::vector<IndexedPair>& valid_pairs,
    int num_threads) {
  const std::vector<double> missing_matches =
      EvidenceOfMissingMatches(scene, index, valid_pairs, num_threads);
  const std::set<std::pair<int, int>> consecutive =
      ConsecutiveImages(scene, index);
  std::vector<JudgedRotation> judged;
  for (size_t i = 0; i < valid_pairs.size(); ++i) {
    const auto& [image1, image2, pair] = valid_pairs[i];
    JudgedRotation rotation;
    rotation.relative = RelativeRotationOf(nodes, valid_pairs[i]);
    if (rotation.relative.node1 == rotation.relative.node2) continue;
    if (missing_matches[i] > kMaxMissingMatches) {
      rotation.cost_if_kept = missing_matches[i];
    }
    rotation.cost_if_outlier = PairEvidence(*pair);
    if (consecutive.count(std::minmax(image1, image2)) == 0) {
      rotation.cost_if_outlier *= kOutlierCostFactor;
    }
    judged.push_back(rotation);
  }
  return judged;
}

// Whether rotations cost less than the average: clearly less, or without
// missing matches as well, which bad intrinsics and motions of pairs make up.
bool AreBetter(const std::vector<JudgedRotation>& judged,
               double max_error_rad,
               const std::vector<Eigen::Quaterniond>& average,
               const std::vector<Eigen::Quaterniond>& rotations) {
  std::vector<JudgedRotation> outliers = judged;
  for (JudgedRotation& rotation : outliers) rotation.cost_if_kept = 0;
  const auto ratio_of = [&](const std::vector<JudgedRotation>& pairs) {
    return CostOfRotations(pairs, max_error_rad, rotations) /
           CostOfRotations(pairs, max_error_rad, average);
  };
  const double cost_ratio = ratio_of(judged);
  const double outlier_ratio = ratio_of(outliers);
  VLOG(1) << "Groups of images turned: cost " << cost_ratio
          << " of the average's, that of outliers " << outlier_ratio;
  return outlier_ratio < 1 ? cost_ratio < 1
                           : outlier_ratio < kMaxOutlierCostRatio &&
                                 cost_ratio < kMaxCostRatio;
}

// The average, or rotations that cost less.
std::optional<RotationAverage> FindBestAverage(
    const ComponentAveragingOptions& options,
    const Scene& scene,
    const FrameMembers& frames,
    const ImageIndex& index,
    const std::vector<IndexedPair>& valid_pairs,
    int num_threads) {
  const RotationNodes nodes(index, frames);
  std::optional<RotationAverage> average =
      AverageRotationsFrom(options, nodes, valid_pairs, /*start=*/{});
  if (!average || options.skip_alternatives ||
      CountStrongOutliers(*average, valid_pairs) < kMinNumStrongOutliers) {
    return average;
  }
  const std::vector<JudgedRotation> judged =
      JudgeRotations(scene, index, nodes, valid_pairs, num_threads);
  const double max_error_rad = MaxRotationErrorRad(options);
  const std::vector<Eigen::Quaterniond> node_from_world =
      nodes.NodeFromWorld(average->cam_from_world);
  const std::vector<Eigen::Quaterniond> turned =
      TurnGroups(judged,
                 max_error_rad,
                 /*fixed_node=*/0,
                 options.rotation_averaging,
                 node_from_world);
  if (!AreBetter(judged, max_error_rad, node_from_world, turned)) {
    return average;
  }
  return AverageOf(options, valid_pairs, nodes.CamFromWorld(turned));
}

// Cuts off all images but those of the largest part that the edges connect.
void KeepLargestPart(const ImageIndex& index,
                     const std::vector<GraphEdge>& edges,
                     ComponentRotations* rotations) {
  const std::vector<int> parts = ConnectedComponents(index.Size(), edges);
  std::map<int, std::vector<colmap::image_t>> images_of_parts;
  std::vector<Eigen::Quaterniond> kept_rotations;
  for (int i = 0; i < index.Size(); ++i) {
    images_of_parts[parts[i]].push_back(index.IdOf(i));
    if (parts[i] == 0) kept_rotations.push_back(rotations->cam_from_world[i]);
  }
  rotations->image_ids = images_of_parts[0];
  rotations->cam_from_world = kept_rotations;
  for (const auto& [part, image_ids] : images_of_parts) {
    if (part != 0) rotations->other_parts.push_back(image_ids);
  }
}

// Refines the rotations by the gravity of the images, where it is known.
void RefineRotationsByGravity(const ComponentAveragingOptions& options,
                              const PosePriors& priors,
                              const FrameMembers& frames,
                              PairGeometries* pairs,
                              ComponentRotations* rotations) {
  if (!options.gravity.use_gravity || priors.empty()) return;
  const ImageIndex index(rotations->image_ids);
  const RotationNodes nodes(index, frames);
  std::vector<NodeGravity> gravities;
  std::vector<int> num_gravities(nodes.num_nodes, 0);
  for (int i = 0; i < index.Size(); ++i) {
    const auto prior = priors.find(index.IdOf(i));
    if (prior == priors.end() || !prior->second.HasGravity()) continue;
    const int node = nodes.node_of_image[i];
    gravities.push_back(
        {node, nodes.cam_from_node[i].conjugate() * prior->second.gravity});
    ++num_gravities[node];
  }
  // The images of a frame have their gravity from one sensor.
  for (NodeGravity& gravity : gravities) {
    gravity.weight = 1.0 / num_gravities[gravity.node];
  }
  const std::vector<IndexedPair> valid_pairs = ValidPairs(index, pairs);
  std::vector<Eigen::Quaterniond> node_from_world =
      nodes.NodeFromWorld(rotations->cam_from_world);
  if (!RefineByGravity(options.gravity,
                       options.rotation_averaging,
                       RelativeRotationsOf(nodes, valid_pairs),
                       gravities,
                       /*fixed_node=*/0,
                       &node_from_world)) {
    return;
  }
  rotations->cam_from_world = nodes.CamFromWorld(node_from_world);
  rotations->num_gravities = gravities.size();
}

std::vector<IndexedPair> ScaledPairs(const ImageIndex& index,
                                     PairGeometries* pairs) {
  std::vector<IndexedPair> scaled_pairs;
  for (const IndexedPair& indexed : ValidPairs(index, pairs)) {
    if (indexed.pair->has_scale) scaled_pairs.push_back(indexed);
  }
  return scaled_pairs;
}

// Images of the index in the largest part that scaled pairs connect.
std::vector<colmap::image_t> LargestScaledPart(const ImageIndex& index,
                                               PairGeometries* pairs) {
  std::vector<GraphEdge> edges;
  for (const IndexedPair& indexed : ScaledPairs(index, pairs)) {
    edges.emplace_back(indexed.image1, indexed.image2);
  }
  std::vector<colmap::image_t> image_ids;
  for (const int image : LargestComponent(index.Size(), edges)) {
    image_ids.push_back(index.IdOf(image));
  }
  return image_ids;
}

}  // namespace

bool ComponentAveragingOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Valid(rotation_averaging)
      .Valid(scale_averaging)
      .AtLeast(
          "num_rotation_averaging_rounds", num_rotation_averaging_rounds, 1)
      .Above("max_rotation_error", max_rotation_error_deg, 0)
      .Valid(gravity)
      .Above("max_log_scale_error", max_log_scale_error, 0)
      .Valid(translation_averaging)
      .Above("max_translation_error_ratio", max_translation_error_ratio, 0)
      .AtLeast("max_translation_error_factor", max_translation_error_factor, 1)
      .AreKept();
}

std::optional<ComponentRotations> AverageComponentRotations(
    const ComponentAveragingOptions& options,
    const Scene& scene,
    const FrameMembers& frames,
    const std::vector<colmap::image_t>& image_ids,
    int num_threads,
    PairGeometries* pairs) {
  ComponentRotations rotations;
  rotations.image_ids = image_ids;
  for (int round = 0; round < options.num_rotation_averaging_rounds; ++round) {
    const ImageIndex index(rotations.image_ids);
    const std::vector<IndexedPair> valid_pairs = ValidPairs(index, pairs);
    std::optional<RotationAverage> average =
        round == 0
            ? FindBestAverage(
                  options, scene, frames, index, valid_pairs, num_threads)
            : AverageRotationsFrom(options,
                                   RotationNodes(index, frames),
                                   valid_pairs,
                                   rotations.cam_from_world);
    if (!average) return std::nullopt;
    rotations.cam_from_world = std::move(average->cam_from_world);
    std::vector<GraphEdge> edges = FrameEdges(index, frames);
    for (size_t i = 0; i < valid_pairs.size(); ++i) {
      if (average->is_outlier[i]) {
        valid_pairs[i].pair->Judge(PairStage::ROTATION_AVERAGING,
                                   PairStatus::ROTATION_OUTLIER);
        ++rotations.num_pairs_filtered;
      } else {
        edges.emplace_back(valid_pairs[i].image1, valid_pairs[i].image2);
      }
    }
    KeepLargestPart(index, edges, &rotations);
  }
  RefineRotationsByGravity(
      options, scene.pose_priors, frames, pairs, &rotations);
  return rotations;
}

ComponentScales AverageComponentScales(const ComponentAveragingOptions& options,
                                       bool skip,
                                       const ImageIndex& index,
                                       PairGeometries* pairs) {
  const ImageIndex scaled_index(LargestScaledPart(index, pairs));
  std::vector<IndexedPair> scaled_pairs = ScaledPairs(scaled_index, pairs);
  std::vector<RelativeLogScale> ratios;
  for (const IndexedPair& indexed : scaled_pairs) {
    ratios.push_back({indexed.image1,
                      indexed.image2,
                      std::log(indexed.pair->scale_1_from_2)});
  }
  ComponentScales result;
  result.num_pairs = ratios.size();
  if (ratios.empty()) return result;
  std::vector<double> log_scales(scaled_index.Size(), 0.0);
  if (!skip) {
    if (!AverageScales(scaled_index.Size(),
                       ratios,
                       /*fixed_node=*/0,
                       options.scale_averaging,
                       &log_scales)) {
      LOG(WARNING) << "Scale averaging failed: images keep scale one";
    }
    for (size_t i = 0; i < ratios.size(); ++i) {
      const double error = log_scales[ratios[i].node2] -
                           log_scales[ratios[i].node1] - ratios[i].log_ratio;
      if (std::abs(error) <= options.max_log_scale_error) continue;
      scaled_pairs[i].pair->DropScale();
      ++result.num_outliers;
    }
  }
  const double median = Median(log_scales);
  // Images that only outliers linked have no scale.
  for (const colmap::image_t image_id :
       LargestScaledPart(scaled_index, pairs)) {
    result.scales[image_id] =
        std::exp(log_scales[scaled_index.Of(image_id)] - median);
  }
  return result;
}

}  // namespace dgsfm
