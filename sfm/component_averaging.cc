#include "sfm/component_averaging.h"

#include "estimators/graph.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <cmath>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Takes out the pairs that are off the rotations; edges are those that stay.
size_t FilterByRotation(const std::vector<Eigen::Quaterniond>& cam_from_world,
                        double max_error_deg,
                        const std::vector<IndexedPair>& valid_pairs,
                        std::vector<GraphEdge>* edges) {
  size_t num_filtered = 0;
  for (const IndexedPair& indexed : valid_pairs) {
    const Eigen::Quaterniond predicted =
        cam_from_world[indexed.image2] *
        cam_from_world[indexed.image1].conjugate();
    const double error_deg =
        predicted.angularDistance(indexed.pair->cam2_from_cam1.rotation) * 180 /
        M_PI;
    if (error_deg > max_error_deg) {
      indexed.pair->status = PairStatus::ROTATION_OUTLIER;
      ++num_filtered;
    } else {
      edges->emplace_back(indexed.image1, indexed.image2);
    }
  }
  return num_filtered;
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
  const std::vector<int> parts = ConnectedComponents(index.Size(), edges);
  std::vector<colmap::image_t> image_ids;
  for (int i = 0; i < index.Size(); ++i) {
    if (parts[i] == 0) image_ids.push_back(index.IdOf(i));
  }
  return image_ids;
}

}  // namespace

bool ComponentAveragingOptions::IsValid(std::string* error) const {
  return rotation_averaging.IsValid(error) && scale_averaging.IsValid(error) &&
         CheckOption(num_rotation_averaging_rounds >= 1,
                     "num_rotation_averaging_rounds must be >= 1",
                     num_rotation_averaging_rounds,
                     error) &&
         CheckOption(max_rotation_error_deg > 0,
                     "max_rotation_error_deg must be > 0",
                     max_rotation_error_deg,
                     error) &&
         CheckOption(max_log_scale_error > 0,
                     "max_log_scale_error must be > 0",
                     max_log_scale_error,
                     error);
}

std::optional<ComponentRotations> AverageComponentRotations(
    const ComponentAveragingOptions& options,
    const std::vector<colmap::image_t>& image_ids,
    PairGeometries* pairs) {
  ComponentRotations rotations;
  rotations.image_ids = image_ids;
  for (int round = 0; round < options.num_rotation_averaging_rounds; ++round) {
    const ImageIndex index(rotations.image_ids);
    const std::vector<IndexedPair> valid_pairs = ValidPairs(index, pairs);
    std::vector<RelativeRotation> relative_rotations;
    for (const IndexedPair& indexed : valid_pairs) {
      relative_rotations.push_back({indexed.image1,
                                    indexed.image2,
                                    indexed.pair->cam2_from_cam1.rotation,
                                    1.0});
    }
    if (!AverageRotations(index.Size(),
                          relative_rotations,
                          /*fixed_node=*/0,
                          options.rotation_averaging,
                          &rotations.cam_from_world)) {
      return std::nullopt;
    }
    std::vector<GraphEdge> edges;
    rotations.num_pairs_filtered +=
        FilterByRotation(rotations.cam_from_world,
                         options.max_rotation_error_deg,
                         valid_pairs,
                         &edges);
    KeepLargestPart(index, edges, &rotations);
  }
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
                      std::log(indexed.pair->scale_1_from_2),
                      1.0});
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
