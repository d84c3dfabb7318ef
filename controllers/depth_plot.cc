#include "controllers/depth_plot.h"

#include "estimators/median.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace dgsfm {
namespace {

using Color = colmap::BitmapColor<uint8_t>;

constexpr int kSize = 320;           // of each side [px]
constexpr double kTailRatio = 0.01;  // of points beyond each end of the axes
const Color kBackground(255, 255, 255);
const Color kDiagonal(190, 190, 190);
const Color kScaled(240, 150, 60);
const Color kAligned(40, 90, 200);

// A square of 2 x 2 pixels, by log depths in units of the axes; upwards.
void DrawPoint(double x, double y, const Color& color, colmap::Bitmap* bitmap) {
  if (!(x >= 0 && x < 1 && y >= 0 && y < 1)) return;
  const int left = static_cast<int>(x * (kSize - 1));
  const int top = static_cast<int>((1 - y) * (kSize - 1));
  for (int row = top; row < std::min(top + 2, kSize); ++row) {
    for (int col = left; col < std::min(left + 2, kSize); ++col) {
      bitmap->SetPixel(col, row, color);
    }
  }
}

}  // namespace

colmap::Bitmap PlotAlignment(const DepthAlignment& alignment,
                             const std::vector<DepthCorrespondence>& points) {
  colmap::Bitmap bitmap;
  if (!bitmap.Allocate(kSize, kSize, /*as_rgb=*/true)) {
    throw std::runtime_error("cannot allocate a picture of this size");
  }
  bitmap.Fill(kBackground);
  for (int i = 0; i < kSize; ++i) {
    bitmap.SetPixel(i, kSize - 1 - i, kDiagonal);
  }
  if (points.empty()) return bitmap;
  std::vector<double> log_depths;
  std::vector<double> log_ratios;
  for (const DepthCorrespondence& point : points) {
    log_depths.push_back(std::log(point.point_depth));
    log_ratios.push_back(std::log(point.point_depth / point.map_depth));
  }
  const double scale = std::exp(Median(std::move(log_ratios)));
  const double min = Quantile(log_depths, kTailRatio);
  const double max = Quantile(log_depths, 1 - kTailRatio);
  // A tenth is left beyond both.
  const double range = std::max(1e-6, 1.2 * (max - min));
  const auto place = [&](double depth) {
    return (std::log(depth) - min) / range + 1.0 / 12;
  };
  for (const DepthCorrespondence& point : points) {
    DrawPoint(place(point.point_depth),
              place(scale * point.map_depth),
              kScaled,
              &bitmap);
  }
  for (const DepthCorrespondence& point : points) {
    DrawPoint(place(point.point_depth),
              place(alignment.Apply(point.u, point.v, point.map_depth)),
              kAligned,
              &bitmap);
  }
  return bitmap;
}

}  // namespace dgsfm
