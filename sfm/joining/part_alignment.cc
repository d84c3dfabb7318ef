#include "sfm/joining/part_alignment.h"

#include "estimators/median.h"
#include "estimators/option_check.h"
#include "sfm/georeferencing/model_alignment.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

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

}  // namespace

bool PartJoiningOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("min_num_shared_images", min_num_shared_images, 3)
      .Within("min_agreeing_share", min_agreeing_share, 0, 1)
      .Above("max_rotation_error", max_rotation_error_deg, 0)
      .Above("max_center_error", max_center_error, 0)
      .Valid(averaging)
      .AreKept();
}

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

std::optional<RelativeSimilarity> AlignPartToPositions(
    const PosePriors& positions,
    const PartModel& part,
    int part_node,
    int position_node) {
  std::vector<PositionMatch> matches;
  std::vector<double> stddevs;
  for (const auto& [image_id, image] : part.images) {
    const auto prior = positions.find(image_id);
    if (prior == positions.end() || !prior->second.HasPosition()) continue;
    const Eigen::Matrix3d& covariance = prior->second.covariance;
    matches.push_back({image.cam_from_part.TargetOriginInSource(),
                       prior->second.position,
                       SqrtInformation(covariance)});
    stddevs.push_back(std::sqrt(covariance.trace() / 3));
  }
  const auto alignment = AlignPositions({}, matches, std::nullopt);
  if (!alignment || !(alignment->log_scale_stddev <= kMaxLogScaleStddev)) {
    return std::nullopt;
  }
  RelativeSimilarity similarity;
  similarity.node1 = part_node;
  similarity.node2 = position_node;
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

std::vector<PartPair> FindPartPairs(const PartJoiningOptions& options,
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

}  // namespace dgsfm
