#include "controllers/initial_cloud.h"

#include "colmap_ext/check.h"
#include "colmap_ext/model/model_writer.h"
#include "controllers/output_folder.h"
#include "controllers/point_colors.h"

#include <colmap/base/reconstruction.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

namespace dgsfm {
namespace {

// Samples per point that is asked for: several images show most surfaces.
constexpr double kSamplesPerPoint = 3;

// A cube, whose side is a power of two near the spacing of its samples, so that
// near and far surfaces keep the detail that images show.
using Cell = std::array<int64_t, 4>;

Cell CellOf(const Eigen::Vector3d& xyz, double spacing) {
  const int level = static_cast<int>(std::lround(std::log2(spacing)));
  const double side = std::ldexp(1.0, level);
  Cell cell = {level, 0, 0, 0};
  for (int i = 0; i < 3; ++i) {
    cell[i + 1] = static_cast<int64_t>(std::floor(xyz[i] / side));
  }
  return cell;
}

struct Merged {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  size_t count = 0;
  // One observation in each image, by the index of its sample.
  std::vector<std::pair<colmap::image_t, colmap::point2D_t>> track;
};

}  // namespace

InitialCloud::InitialCloud(
    const SparseModel& model,
    const std::map<std::string, colmap::image_t>& image_ids,
    size_t max_num_points)
    : model_(model), max_num_points_(max_num_points) {
  DGSFM_CHECK(max_num_points > 0);
  colmap::image_t next_id = 1;
  for (const auto& [name, id] : image_ids) next_id = std::max(next_id, id + 1);
  for (const auto& [name, image] : model.images) {
    const auto id = image_ids.find(name);
    images_[name].image_id = id != image_ids.end() ? id->second : next_id++;
  }
}

void InitialCloud::Add(const std::string& image_name,
                       const DepthMap& depth_map) {
  const colmap::Camera& camera = CameraOfImage(model_, image_name);
  const Rigid3d world_from_cam =
      model_.images.at(image_name).cam_from_world.Inverse();
  const double num_wanted =
      kSamplesPerPoint * max_num_points_ / model_.images.size();
  const double num_known = depth_map.Coverage() * depth_map.values.size();
  const int step = static_cast<int>(
      std::max(1.0, std::floor(std::sqrt(num_known / num_wanted))));
  const double x_scale = double(camera.Width()) / depth_map.width;
  const double y_scale = double(camera.Height()) / depth_map.height;
  const double spacing_per_depth = step * x_scale / camera.MeanFocalLength();
  std::vector<Sample>& samples = images_.at(image_name).samples;
  for (int y = step / 2; y < depth_map.height; y += step) {
    for (int x = step / 2; x < depth_map.width; x += step) {
      const double depth = depth_map.At(x, y);
      if (depth <= 0) continue;
      Sample sample;
      sample.xy = {(x + 0.5) * x_scale, (y + 0.5) * y_scale};
      sample.xyz = world_from_cam *
                   (depth * camera.ImageToWorld(sample.xy).homogeneous());
      sample.spacing = depth * spacing_per_depth;
      if (sample.xyz.allFinite()) samples.push_back(sample);
    }
  }
}

size_t InitialCloud::Write(const std::string& output_path,
                           const std::string& image_path,
                           int num_threads) const {
  colmap::Reconstruction cloud;
  std::map<Cell, Merged> cells;
  for (const auto& [id, camera] : model_.cameras) cloud.AddCamera(camera);
  for (const auto& [name, image] : images_) {
    const ModelImage& posed = model_.images.at(name);
    colmap::Image copy;
    copy.SetImageId(image.image_id);
    copy.SetName(name);
    copy.SetCameraId(posed.camera_id);
    copy.SetQvec(QvecFromRotation(posed.cam_from_world.rotation));
    copy.SetTvec(posed.cam_from_world.translation);
    std::vector<Eigen::Vector2d> points2D;
    for (const Sample& sample : image.samples) {
      Merged& merged = cells[CellOf(sample.xyz, sample.spacing)];
      merged.sum += sample.xyz;
      ++merged.count;
      if (merged.track.empty() || merged.track.back().first != image.image_id) {
        merged.track.emplace_back(image.image_id, points2D.size());
      }
      points2D.push_back(sample.xy);
    }
    copy.SetPoints2D(points2D);
    cloud.AddImage(std::move(copy));
    cloud.RegisterImage(image.image_id);
  }
  // If there are too many cells, an even choice is taken in their order.
  const size_t num_points = std::min(max_num_points_, cells.size());
  size_t i = 0;
  for (const auto& [cell, merged] : cells) {
    const bool is_chosen =
        (i + 1) * num_points / cells.size() > i * num_points / cells.size();
    ++i;
    if (!is_chosen) continue;
    colmap::Track track;
    for (const auto& [image_id, index] : merged.track) {
      track.AddElement(image_id, index);
    }
    cloud.AddPoint3D(merged.sum / double(merged.count), track);
  }
  if (!image_path.empty()) ExtractPointColors(image_path, num_threads, &cloud);
  CreateOutputFolder(output_path);
  WriteModel(cloud, output_path);
  return num_points;
}

}  // namespace dgsfm
