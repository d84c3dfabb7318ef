#include "sfm/verification/depth_kind.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <Eigen/Core>

namespace dgsfm {

namespace {

constexpr int kNumArrangements = 8;
// Cells along each side of an image in which the nearest key point is looked
// for; its distance is at most about one cell.
constexpr int kNumCells = 48;
// Images, and pairs of each, that show the kind before there is a model: more
// show the same.
constexpr size_t kMaxNumImagesByPairs = 20;
constexpr size_t kMaxNumPairsOfImage = 5;
// Places of an image that are compared, of those that have a value: the
// standard error of the concordance of 200 is 0.05, far below what decides.
constexpr size_t kMaxNumJudgedPlaces = 200;
// How much better the other kind or arrangement has to be.
constexpr double kMinAdvantage = 0.3;

// Where the map has the value of the image position (u, v), both in units of
// width and height.
Eigen::Vector2d PlaceInMap(int arrangement, double u, double v) {
  switch (static_cast<MapArrangement>(arrangement)) {
    case MapArrangement::AS_GIVEN:
      break;
    case MapArrangement::MIRRORED:
      return {1 - u, v};
    case MapArrangement::UPSIDE_DOWN:
      return {u, 1 - v};
    case MapArrangement::HALF_TURN:
      return {1 - u, 1 - v};
    case MapArrangement::TRANSPOSED:
      return {v, u};
    case MapArrangement::QUARTER_TURN:
      return {1 - v, u};
    case MapArrangement::QUARTER_TURN_3:
      return {v, 1 - u};
    case MapArrangement::ANTI_TRANSPOSED:
      return {1 - v, 1 - u};
  }
  return {u, v};
}

std::string ArrangementText(int arrangement) {
  switch (static_cast<MapArrangement>(arrangement)) {
    case MapArrangement::AS_GIVEN:
      return "as they are";
    case MapArrangement::MIRRORED:
      return "mirrored (left and right exchanged)";
    case MapArrangement::UPSIDE_DOWN:
      return "upside down (top and bottom exchanged)";
    case MapArrangement::HALF_TURN:
      return "turned by 180 degrees";
    case MapArrangement::TRANSPOSED:
      return "transposed (rows and columns exchanged)";
    case MapArrangement::QUARTER_TURN:
      return "turned by 90 degrees clockwise";
    case MapArrangement::QUARTER_TURN_3:
      return "turned by 90 degrees counter-clockwise";
    case MapArrangement::ANTI_TRANSPOSED:
      return "transposed and turned by 180 degrees";
  }
  return "unknown";
}

// Values of the map at any place, by the nearest key point.
class NearestValues {
 public:
  NearestValues(const colmap::Image& image,
                const colmap::Camera& camera,
                const KeypointDepths& depths)
      : size_(double(camera.Width()), double(camera.Height())),
        num_keypoints_(image.NumPoints2D()) {
    for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
      const double value = depths.depths[i];
      if (value == 0) continue;
      ++num_known_;
      const Eigen::Vector2d place = image.Point2D(i).XY().cwiseQuotient(size_);
      cells_[CellOf(place.x()) + kNumCells * CellOf(place.y())].push_back(
          {place, value});
    }
  }

  Eigen::Vector2d PlaceOf(const Eigen::Vector2d& xy_px) const {
    return xy_px.cwiseQuotient(size_);
  }

  // Share of the key points that have a value [1].
  double KnownShare() const {
    return num_known_ == 0 ? 0 : double(num_known_) / double(num_keypoints_);
  }

  // 0 if there is none near.
  double At(const Eigen::Vector2d& place) const {
    double nearest_distance = 1.0 / (kNumCells * kNumCells);
    double value = 0;
    for (int y = CellOf(place.y()) - 1; y <= CellOf(place.y()) + 1; ++y) {
      for (int x = CellOf(place.x()) - 1; x <= CellOf(place.x()) + 1; ++x) {
        if (x < 0 || y < 0 || x >= kNumCells || y >= kNumCells) continue;
        for (const Entry& entry : cells_[x + kNumCells * y]) {
          const double distance = (entry.place - place).squaredNorm();
          if (distance < nearest_distance) {
            nearest_distance = distance;
            value = entry.value;
          }
        }
      }
    }
    return value;
  }

 private:
  struct Entry {
    Eigen::Vector2d place;
    double value = 0;
  };

  static int CellOf(double coordinate) {
    return int(std::clamp(coordinate * kNumCells, 0.0, kNumCells - 1.0));
  }

  const Eigen::Vector2d size_;
  const size_t num_keypoints_;
  size_t num_known_ = 0;
  std::array<std::vector<Entry>, kNumCells * kNumCells> cells_;
};

std::string KindRemedy(DepthUnit unit) {
  if (unit == DepthUnit::AFFINE_DISPARITY) {
    return "their values grow with depth, as depth does: import them with "
           "--depth_type relative_depth, or z if they are depth up to a factor";
  }
  return "their values fall with depth, as disparity does: import them with "
         "--depth_type relative_disparity, or inverse if they are 1 / z";
}

}  // namespace

std::vector<double> ConcordancesByArrangement(
    const colmap::Image& image,
    const colmap::Camera& camera,
    const KeypointDepths& depths,
    const std::vector<MeasuredDepths>& measured) {
  const NearestValues values(image, camera, depths);
  size_t num_places = 0;
  for (const MeasuredDepths& of_unit : measured) num_places += of_unit.size();
  const auto step = 1 + size_t(values.KnownShare() * double(num_places) /
                               kMaxNumJudgedPlaces);
  std::vector<double> concordances;
  for (int k = 0; k < kNumArrangements; ++k) {
    double sum = 0;
    size_t num_samples = 0;
    for (const MeasuredDepths& of_unit : measured) {
      std::vector<AffineDepthSample> samples;
      for (size_t i = 0; i < of_unit.size(); i += step) {
        const MeasuredDepth& point = of_unit[i];
        const Eigen::Vector2d place =
            values.PlaceOf(image.Point2D(point.point2D_idx).XY());
        const double value = values.At(PlaceInMap(k, place.x(), place.y()));
        if (value != 0 && point.depth > 0) {
          samples.push_back({value, point.depth});
        }
      }
      sum += double(samples.size()) * Concordance(samples);
      num_samples += samples.size();
    }
    const double sign = depths.unit == DepthUnit::AFFINE_DISPARITY ? -1 : 1;
    concordances.push_back(num_samples < kMinNumJudgedPlaces
                               ? 0
                               : sign * sum / double(num_samples));
  }
  return concordances;
}

std::string ExplainWrongKind(
    DepthUnit unit, const std::vector<std::vector<double>>& concordances) {
  if (concordances.size() < kMinNumJudgedImages) return "";
  std::vector<double> means(kNumArrangements);
  for (const std::vector<double>& of_image : concordances) {
    for (int k = 0; k < kNumArrangements; ++k) {
      means[k] += of_image[k] / double(concordances.size());
    }
  }
  int best = 0;
  for (int k = 1; k < kNumArrangements; ++k) {
    if (std::abs(means[k]) > std::abs(means[best])) best = k;
  }
  if (std::abs(means[best]) < kMinMeanConcordance ||
      std::abs(means[best]) < means[0] + kMinAdvantage) {
    return "";
  }
  if (best == 0) return KindRemedy(unit);
  std::string text = "they fit the triangulated depths better if they are " +
                     ArrangementText(best) +
                     ": write them as the images are stored, or, where viewers "
                     "turn the images "
                     "by EXIF, import them with --displayed_image_path";
  if (means[best] < 0) text += "; besides, " + KindRemedy(unit);
  return text;
}

std::string ExplainWrongKindByPairs(const Scene& scene,
                                    const PairGeometries& pairs,
                                    const KeypointDepthMap& depths) {
  std::vector<colmap::image_t> with_maps;
  for (const auto& [image_id, image_depths] : depths) {
    if (!IsAffine(image_depths.unit)) with_maps.push_back(image_id);
  }
  std::vector<colmap::image_t> image_ids;
  const size_t step = with_maps.size() / kMaxNumImagesByPairs + 1;
  for (size_t i = 0; i < with_maps.size(); i += step) {
    image_ids.push_back(with_maps[i]);
  }
  std::vector<std::vector<double>> concordances;
  for (const auto& [image_id, of_pairs] :
       MeasureDepthsByPairs(scene, pairs, image_ids, kMaxNumPairsOfImage)) {
    const colmap::Image& image = scene.images.at(image_id);
    concordances.push_back(
        ConcordancesByArrangement(image,
                                  scene.cameras.at(image.CameraId()),
                                  depths.at(image_id),
                                  of_pairs));
    // Too few places of the image have depths by pairs.
    if (concordances.back()[0] == 0) concordances.pop_back();
  }
  return ExplainWrongKind(DepthUnit::METRIC, concordances);
}

bool HasOneValue(const KeypointDepths& depths) {
  float value = 0;
  size_t num_known = 0;
  for (const float depth : depths.depths) {
    if (depth == 0) continue;
    if (num_known > 0 && depth != value) return false;
    value = depth;
    ++num_known;
  }
  return num_known >= kMinNumJudgedPlaces;
}

}  // namespace dgsfm
