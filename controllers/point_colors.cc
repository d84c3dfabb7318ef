#include "controllers/point_colors.h"

#include "colmap_ext/formats/image_header.h"
#include "colmap_ext/output_file.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/progress.h"
#include "sfm/mapping/model_access.h"

#include <colmap/util/bitmap.h>

#include <algorithm>
#include <stdexcept>
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

// JPEG at half its size. Throws std::runtime_error naming the file.
colmap::Bitmap ReadForColors(const std::string& path) {
  int flags = 0;
  if (FreeImage_GetFileType(path.c_str()) == FIF_JPEG) {
    const ImageFile header = ReadImageHeader(path);
    // FreeImage takes the size to be decoded to from the upper half.
    const unsigned size = std::max(FreeImage_GetWidth(header.get()),
                                   FreeImage_GetHeight(header.get()));
    flags = int(size / 2 << 16) | JPEG_FAST;
  }
  FIBITMAP* rgb = FreeImage_ConvertTo24Bits(ReadImageFile(path, flags).get());
  if (rgb == nullptr) throw std::runtime_error("no colours in image " + path);
  return colmap::Bitmap(rgb);
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
  Progress progress("Colours of the points", image_ids.size());
  ParallelFor(image_ids.size(), num_threads, [&](size_t i) {
    const colmap::Image& image = model->Image(image_ids[i]);
    try {
      colors[i] =
          ColorsInImage(image,
                        model->Camera(image.CameraId()),
                        ReadForColors(PathInside(image_path, image.Name())));
      // Colours are decoration: a model without some of them is still useful.
    } catch (const std::runtime_error& error) {
      LOG(WARNING) << "No colours: " << error.what();
    }
    progress.Step();
  });
  // Summed in the order of images, so that threads do not change the rounding.
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
