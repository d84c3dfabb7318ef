#include "controllers/point_colors.h"

#include "colmap_ext/parallel.h"
#include "sfm/model_access.h"

#include <colmap/util/bitmap.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <unordered_map>
#include <utility>
#include <vector>

#include <glog/logging.h>

namespace dgsfm {

namespace {

struct ColorSum {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  size_t count = 0;
};

bool ReadForColors(const std::string& path, colmap::Bitmap* bitmap) {
  if (FreeImage_GetFileType(path.c_str()) != FIF_JPEG) {
    return bitmap->Read(path);
  }
  // FreeImage takes the size to be decoded to from the upper half of its flags.
  FIBITMAP* header = FreeImage_Load(FIF_JPEG, path.c_str(), FIF_LOAD_NOPIXELS);
  if (header == nullptr) return false;
  const unsigned size =
      std::max(FreeImage_GetWidth(header), FreeImage_GetHeight(header)) / 2;
  FreeImage_Unload(header);
  FIBITMAP* decoded =
      FreeImage_Load(FIF_JPEG, path.c_str(), int(size << 16) | JPEG_FAST);
  if (decoded == nullptr) return false;
  FIBITMAP* rgb = FreeImage_ConvertTo24Bits(decoded);
  FreeImage_Unload(decoded);
  if (rgb == nullptr) return false;
  *bitmap = colmap::Bitmap(rgb);
  return true;
}

std::vector<std::pair<colmap::point3D_t, Eigen::Vector3d>> ColorsInImage(
    const colmap::Image& image,
    const colmap::Camera& camera,
    const colmap::Bitmap& bitmap) {
  const double x_scale = bitmap.Width() / double(camera.Width());
  const double y_scale = bitmap.Height() / double(camera.Height());
  std::vector<std::pair<colmap::point3D_t, Eigen::Vector3d>> colors;
  for (const colmap::Point2D& point2D : image.Points2D()) {
    colmap::BitmapColor<float> color;
    // COLMAP's upper left pixel has its centre at (0.5, 0.5).
    if (point2D.HasPoint3D() &&
        bitmap.InterpolateBilinear(
            x_scale * point2D.X() - 0.5, y_scale * point2D.Y() - 0.5, &color)) {
      colors.emplace_back(point2D.Point3DId(),
                          Eigen::Vector3d(color.r, color.g, color.b));
    }
  }
  return colors;
}

}  // namespace

void ExtractPointColors(const std::string& image_path,
                        int num_threads,
                        colmap::Reconstruction* model) {
  const std::vector<colmap::image_t> image_ids = SortedRegisteredImages(*model);
  std::vector<std::vector<std::pair<colmap::point3D_t, Eigen::Vector3d>>>
      colors(image_ids.size());
  ParallelFor(image_ids.size(), num_threads, [&](size_t i) {
    const colmap::Image& image = model->Image(image_ids[i]);
    const std::string path =
        (std::filesystem::path(image_path) / image.Name()).string();
    colmap::Bitmap bitmap;
    if (!ReadForColors(path, &bitmap)) {
      LOG(WARNING) << "Cannot read " << path << " for colours";
      return;
    }
    colors[i] = ColorsInImage(image, model->Camera(image.CameraId()), bitmap);
  });
  std::unordered_map<colmap::point3D_t, ColorSum> sums;
  for (const auto& colors_in_image : colors) {
    for (const auto& [point_id, color] : colors_in_image) {
      ColorSum& sum = sums[point_id];
      sum.sum += color;
      ++sum.count;
    }
  }
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    const auto it = sums.find(point_id);
    Eigen::Vector3ub color = Eigen::Vector3ub::Zero();
    if (it != sums.end()) {
      color = (it->second.sum / double(it->second.count))
                  .array()
                  .round()
                  .cast<uint8_t>();
    }
    model->Point3D(point_id).SetColor(color);
  }
}

}  // namespace dgsfm
