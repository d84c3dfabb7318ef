#include "sfm/view_graph/component_averaging.h"

#include "estimators/averaging/graph.h"
#include "estimators/median.h"
#include "estimators/option_check.h"
#include "sfm/view_graph/missing_matches.h"
#include "sfm/view_graph/pair_evidence.h"
#include "sfm/view_graph/rotation_nodes.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Strong pairs among the outliers are kept by this factor of their weight in
// the averages that are tried instead.
constexpr double kKeptWeightFactor = 100;
constexpr double kStrongProbability = 0.9;
// Fewer strong outliers are accidents.
constexpr int kMinNumStrongOutliers = 3;
constexpr int kMaxNumAlternatives = 3;
// Missing matches below this are within what true pairs show [nat].
constexpr double kMaxMissingMatches = 12;
// Above, they divide the weight of their pair by e each time they grow by this.
constexpr double kMissingMatchesPerFold = 4;
// Cost of an alternative over that of the first average, at most: where depth
// maps belong to other images, averages that take out true pairs come to 0.61.
constexpr double kMaxCostRatio = 0.6;
// Inliers of look-alikes have one cause, which pairs share: their evidence
// counts less than that of missing matches.
constexpr double kOutlierCostFactor = 0.25;

// Rotations of the images and the pairs that are off.
struct RotationAverage {
  std::vector<Eigen::Quaterniond> cam_from_world;
  std::vector<char> is_outlier;
};

// The rotations of the pairs between different nodes.
std::vector<RelativeRotation> RelativeRotationsOf(
    const RotationNodes& nodes,
    const std::vector<IndexedPair>& valid_pairs,
    const std::vector<double>& weight_factors) {
  std::vector<RelativeRotation> relative_rotations;
  for (size_t i = 0; i < valid_pairs.size(); ++i) {
    const auto& [image1, image2, pair] = valid_pairs[i];
    RelativeRotation relative;
    relative.node1 = nodes.node_of_image[image1];
    relative.node2 = nodes.node_of_image[image2];
    if (relative.node1 == relative.node2) continue;
    relative.cam2_from_cam1 = nodes.cam_from_node[image2].conjugate() *
                              pair->cam2_from_cam1.rotation *
                              nodes.cam_from_node[image1];
    relative.weight = PairEvidence(*pair) * weight_factors[i];
    relative_rotations.push_back(relative);
  }
  return relative_rotations;
}

std::optional<RotationAverage> AverageRotationsKeeping(
    const ComponentAveragingOptions& options,
    const RotationNodes& nodes,
    const std::vector<IndexedPair>& valid_pairs,
    const std::vector<double>& weight_factors,
    const std::vector<Eigen::Quaterniond>& start) {
  std::vector<Eigen::Quaterniond> node_from_world = nodes.NodeFromWorld(start);
  if (nodes.num_nodes == 1) {
    node_from_world.assign(1, Eigen::Quaterniond::Identity());
  } else if (!AverageRotations(
                 nodes.num_nodes,
                 RelativeRotationsOf(nodes, valid_pairs, weight_factors),
                 /*fixed_node=*/0,
                 options.rotation_averaging,
                 &node_from_world)) {
    return std::nullopt;
  }
  RotationAverage average;
  average.cam_from_world = nodes.CamFromWorld(node_from_world);
  for (const auto& [image1, image2, pair] : valid_pairs) {
    const Eigen::Quaterniond predicted =
        average.cam_from_world[image2] *
        average.cam_from_world[image1].conjugate();
    average.is_outlier.push_back(
        predicted.angularDistance(pair->cam2_from_cam1.rotation) * 180 / M_PI >
        options.max_rotation_error_deg);
  }
  return average;
}

// Evidence against an average: outliers that had evidence, and matches that
// the other pairs miss [nat].
double CostOf(const RotationAverage& average,
              const std::vector<IndexedPair>& valid_pairs,
              const std::vector<double>& missing_matches) {
  double cost = 0;
  for (size_t i = 0; i < valid_pairs.size(); ++i) {
    cost += average.is_outlier[i]
                ? kOutlierCostFactor * PairEvidence(*valid_pairs[i].pair)
                : missing_matches[i];
  }
  return cost;
}

// Raises the weight of strong pairs among the outliers; their number.
int KeepStrongOutliers(const RotationAverage& average,
                       const std::vector<IndexedPair>& valid_pairs,
                       std::vector<double>* weight_factors) {
  int num_strong = 0;
  for (size_t i = 0; i < valid_pairs.size(); ++i) {
    double& factor = (*weight_factors)[i];
    if (!average.is_outlier[i] || factor != 1 ||
        PairProbability(*valid_pairs[i].pair) < kStrongProbability) {
      continue;
    }
    factor = kKeptWeightFactor;
    ++num_strong;
  }
  return num_strong;
}

std::optional<RotationAverage> FindBestAverage(
    const ComponentAveragingOptions& options,
    const Scene& scene,
    const KeypointDepthMap& depths,
    const FrameMembers& frames,
    const ImageIndex& index,
    const std::vector<IndexedPair>& valid_pairs,
    const PairGeometries& pairs) {
  const RotationNodes nodes(index, frames);
  const auto average_with = [&](const std::vector<double>& factors) {
    return AverageRotationsKeeping(
        options, nodes, valid_pairs, factors, /*start=*/{});
  };
  std::vector<double> weight_factors(valid_pairs.size(), 1);
  std::optional<RotationAverage> best = average_with(weight_factors);
  if (!best || options.skip_alternatives ||
      KeepStrongOutliers(*best, valid_pairs, &weight_factors) <
          kMinNumStrongOutliers) {
    return best;
  }
  const MissingMatches missing_matches(scene, depths, pairs);
  std::vector<double> missing;
  std::vector<double> trusted_factors;
  for (const IndexedPair& indexed : valid_pairs) {
    const double evidence = missing_matches.EvidenceAgainst(
        PairIdOfImages(index.IdOf(indexed.image1), index.IdOf(indexed.image2)));
    missing.push_back(evidence > kMaxMissingMatches ? evidence : 0);
    trusted_factors.push_back(
        std::exp(-missing.back() / kMissingMatchesPerFold));
  }
  double best_cost = kMaxCostRatio * CostOf(*best, valid_pairs, missing);
  for (std::vector<double> factors : {weight_factors, trusted_factors}) {
    for (int i = 0; i < kMaxNumAlternatives; ++i) {
      std::optional<RotationAverage> average = average_with(factors);
      if (!average) break;
      const double cost = CostOf(*average, valid_pairs, missing);
      const int num_strong =
          KeepStrongOutliers(*average, valid_pairs, &factors);
      VLOG(1) << "Rotations that keep " << num_strong
              << " more strong pairs cost " << cost << ", to win at most "
              << best_cost;
      if (cost < best_cost) {
        best_cost = cost;
        best = std::move(average);
      }
      if (num_strong < kMinNumStrongOutliers) break;
    }
  }
  return best;
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
  if (!RefineByGravity(
          options.gravity,
          options.rotation_averaging,
          RelativeRotationsOf(
              nodes, valid_pairs, std::vector<double>(valid_pairs.size(), 1)),
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
      .Above("max_rotation_error_deg", max_rotation_error_deg, 0)
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
    const KeypointDepthMap& depths,
    const FrameMembers& frames,
    const std::vector<colmap::image_t>& image_ids,
    PairGeometries* pairs) {
  ComponentRotations rotations;
  rotations.image_ids = image_ids;
  for (int round = 0; round < options.num_rotation_averaging_rounds; ++round) {
    const ImageIndex index(rotations.image_ids);
    const std::vector<IndexedPair> valid_pairs = ValidPairs(index, pairs);
    std::optional<RotationAverage> average =
        round == 0
            ? FindBestAverage(
                  options, scene, depths, frames, index, valid_pairs, *pairs)
            : AverageRotationsKeeping(
                  options,
                  RotationNodes(index, frames),
                  valid_pairs,
                  std::vector<double>(valid_pairs.size(), 1),
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
