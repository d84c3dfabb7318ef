#include "controllers/report/model_summary.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <unordered_map>

namespace dgsfm {
namespace {

constexpr size_t kGridSize = 10;
constexpr size_t kNumErrorSteps = 40;
constexpr size_t kMaxTrackLength = 20;

// Infinite where the point is not in front of the camera.
double ReprojectionError(const colmap::Camera& camera,
                         const Rigid3d& cam_from_world,
                         const Eigen::Vector3d& xyz,
                         const Eigen::Vector2d& xy) {
  const Eigen::Vector3d in_cam = cam_from_world * xyz;
  if (!(in_cam.z() > 0)) return std::numeric_limits<double>::infinity();
  const double error = (camera.WorldToImage(in_cam.hnormalized()) - xy).norm();
  return std::isnan(error) ? std::numeric_limits<double>::infinity() : error;
}

// The upper of two middle values, so that an infinite error beside it does not
// count; 0 without values.
double UpperMedian(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

size_t Cell(double ratio, size_t num_cells) {
  return size_t(std::clamp(ratio * num_cells, 0.0, num_cells - 1.0));
}

// Ceiling of the quotient, at least 1.
size_t Stride(size_t count, size_t max_count) {
  return std::max<size_t>(1, (count + max_count - 1) / max_count);
}

class Summarizer {
 public:
  Summarizer(const std::string& folder, size_t max_points, size_t max_views)
      : folder_(folder), points_(ReadModelPoints(folder)) {
    summary_.cameras = ReadModelCameras(folder);
    // The order of files is not that of ids in all versions of COLMAP.
    std::sort(points_.begin(), points_.end(), [](const auto& a, const auto& b) {
      return a.point3D_id < b.point3D_id;
    });
    summary_.num_points = points_.size();
    summary_.track_histogram.resize(kMaxTrackLength + 1);
    summary_.error_histogram.resize(kNumErrorSteps + 1);
    for (size_t i = 0; i < points_.size(); ++i) {
      const size_t length = points_[i].track_length;
      index_of_point_.emplace(points_[i].point3D_id, i);
      summary_.num_observations += length;
      ++summary_.track_histogram[std::min(length, kMaxTrackLength)];
    }
    stride_ = std::max(Stride(points_.size(), max_points),
                       Stride(summary_.num_observations, max_views));
    for (size_t i = 0; i < points_.size(); i += stride_) {
      summary_.shown_points.push_back({points_[i], {}});
    }
  }

  ModelSummary Run() {
    std::vector<double> errors;
    errors.reserve(summary_.num_observations);
    uint32_t index = 0;
    for (const auto& [name, image] : ReadModelImages(folder_)) {
      const std::vector<double> errors_of_image =
          AddImage(name, image, index++);
      errors.insert(
          errors.end(), errors_of_image.begin(), errors_of_image.end());
    }
    for (const double error : errors) {
      ++summary_.error_histogram[size_t(
          std::min<double>(error / kErrorStepPx, kNumErrorSteps))];
    }
    summary_.median_error_px = UpperMedian(std::move(errors));
    return std::move(summary_);
  }

 private:
  // Returns the errors of its observations.
  std::vector<double> AddImage(const std::string& name,
                               const ModelImage& image,
                               uint32_t index) {
    const auto camera = summary_.cameras.find(image.camera_id);
    if (camera == summary_.cameras.end()) {
      throw std::runtime_error("image " + name +
                               " has no camera in the model " + folder_);
    }
    const double width = camera->second.Width();
    const double height = camera->second.Height();
    std::vector<double> errors;
    std::bitset<kGridSize * kGridSize> cells;
    for (const ModelObservation& observation : image.observations) {
      const auto found = index_of_point_.find(observation.point3D_id);
      if (found == index_of_point_.end()) continue;
      const Eigen::Vector2d& xy = observation.xy;
      errors.push_back(ReprojectionError(camera->second,
                                         image.cam_from_world,
                                         points_[found->second].xyz,
                                         xy));
      const double x = xy.x() / width;
      const double y = xy.y() / height;
      cells.set(Cell(y, kGridSize) * kGridSize + Cell(x, kGridSize));
      if (found->second % stride_ == 0) {
        summary_.shown_points[found->second / stride_].views.push_back(
            {index, uint8_t(Cell(x, 256)), uint8_t(Cell(y, 256))});
      }
    }
    ImageSummary& summary = summary_.images[name];
    summary.camera_id = image.camera_id;
    summary.cam_from_world = image.cam_from_world;
    summary.num_points = errors.size();
    summary.coverage = double(cells.count()) / cells.size();
    summary.median_error_px = UpperMedian(errors);
    return errors;
  }

  const std::string folder_;
  std::vector<ModelPoint> points_;
  std::unordered_map<colmap::point3D_t, size_t> index_of_point_;
  size_t stride_ = 1;
  ModelSummary summary_;
};

}  // namespace

ModelSummary SummarizeModel(const std::string& folder,
                            size_t max_num_points,
                            size_t max_num_views) {
  return Summarizer(folder, max_num_points, max_num_views).Run();
}

}  // namespace dgsfm
