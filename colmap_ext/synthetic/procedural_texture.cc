#include "colmap_ext/synthetic/procedural_texture.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

namespace dgsfm {

namespace {

using Color = Eigen::Vector3f;

// Mixes the bits of a cell and seed (the finaliser of MurmurHash3).
uint32_t Hash(int x, int y, uint32_t seed) {
  uint32_t hash = uint32_t(x) * 0x8da6b343u ^ uint32_t(y) * 0xd8163841u ^
                  seed * 0xcb1ab31fu;
  hash = (hash ^ (hash >> 16)) * 0x85ebca6bu;
  hash = (hash ^ (hash >> 13)) * 0xc2b2ae35u;
  return hash ^ (hash >> 16);
}

// In [0, 1).
double HashUniform(int x, int y, uint32_t seed) {
  return Hash(x, y, seed) * 0x1.0p-32;
}

int Floor(double x) { return static_cast<int>(std::floor(x)); }

// 1 for detail that is large against the footprint, 0 for what it averages.
double Visibility(double detail_size, double footprint) {
  return std::clamp(detail_size / footprint - 1, 0., 1.);
}

double SmoothNoise(const Eigen::Vector2d& xy, uint32_t seed) {
  const int x = Floor(xy.x());
  const int y = Floor(xy.y());
  const double fx = xy.x() - x;
  const double fy = xy.y() - y;
  const double wx = fx * fx * (3 - 2 * fx);
  const double wy = fy * fy * (3 - 2 * fy);
  const double top =
      (1 - wx) * HashUniform(x, y, seed) + wx * HashUniform(x + 1, y, seed);
  const double bottom = (1 - wx) * HashUniform(x, y + 1, seed) +
                        wx * HashUniform(x + 1, y + 1, seed);
  return 2 * ((1 - wy) * top + wy * bottom) - 1;
}

// Brightness in [-1, 1] of sharp-edged discs and bars, at most one in each
// square cell, 0 elsewhere.
double Marks(const Eigen::Vector2d& uv,
             double cell_size,
             double footprint,
             uint32_t seed) {
  const double visibility = Visibility(cell_size / 4, footprint);
  if (visibility == 0) return 0;
  const Eigen::Vector2d xy = uv / cell_size;
  const int x = Floor(xy.x());
  const int y = Floor(xy.y());
  const auto draw = [&](uint32_t k) { return HashUniform(x, y, seed + k); };
  // Shapes stay inside of their cell: centre in [0.35, 0.65], radius <= 0.35.
  Eigen::Vector2d offset =
      xy - Eigen::Vector2d(x + 0.35 + 0.3 * draw(1), y + 0.35 + 0.3 * draw(2));
  const double angle = M_PI * draw(3);
  offset = Eigen::Rotation2Dd(angle) * offset;
  const double radius = 0.1 + 0.23 * draw(4);
  const bool inside = draw(5) < 0.4 ? offset.norm() < radius
                                    : std::abs(offset.x()) < 0.9 * radius &&
                                          std::abs(offset.y()) < 0.4 * radius;
  return inside ? visibility * (2 * draw(6) - 1) : 0;
}

// What makes each place of a surface unlike any other, as a brightness factor.
float Weathering(const Eigen::Vector2d& uv, double footprint, uint32_t seed) {
  return 1 + 0.30 * FractalNoise(uv, 2, footprint, seed) +
         0.20 * Marks(uv, 1.1, footprint, seed + 10) +
         0.24 * Marks(uv, 0.37, footprint, seed + 20);
}

// Brightness factor of masonry: rows shifted by half a block.
float Masonry(const Eigen::Vector2d& uv,
              const Eigen::Vector2d& block_size,
              double footprint,
              uint32_t seed) {
  const double y = uv.y() / block_size.y();
  const int row = Floor(y);
  const double x = uv.x() / block_size.x() + 0.5 * (row & 1);
  const int column = Floor(x);
  const double visibility = Visibility(0.5 * block_size.minCoeff(), footprint);
  const double tone = 0.4 * (HashUniform(column, row, seed) - 0.5);
  const double joint = 0.03;  // [m]
  const bool in_joint = (x - column) * block_size.x() < joint ||
                        (y - row) * block_size.y() < joint;
  return 1 + visibility * (in_joint ? -0.4 : tone);
}

// One window of a facade: `xy` [m] from its lower middle; width 1.1 m, height
// 1.6 m. Returns whether the position belongs to the window.
bool PaintWindow(const Eigen::Vector2d& xy,
                 const Color& accent,
                 double footprint,
                 Color* color) {
  const double x = std::abs(xy.x());
  const double y = xy.y();
  if (y > -0.15 && y < 0 && x < 0.75) {
    *color = Color(0.80f, 0.78f, 0.74f);  // sill
  } else if (y < 0 || y > 1.6 || x > 1.05) {
    return false;
  } else if (x > 0.55) {
    const double visibility = Visibility(0.05, footprint);
    const bool gap = std::fmod(y, 0.1) < 0.03;
    *color = accent * (1 - (gap ? 0.45 : 0.) * visibility);  // shutter
  } else if (x > 0.47 || y > 1.5 || y < 0.08 || x < 0.04 ||
             std::abs(y - 0.95) < 0.035) {
    *color = Color(0.92f, 0.90f, 0.85f);  // frame and cross
  } else {
    const float sky = 0.10f + 0.12f * y;
    *color = Color(0.10f + sky, 0.16f + sky, 0.24f + sky);  // glass
  }
  return true;
}

}  // namespace

double FractalNoise(const Eigen::Vector2d& uv,
                    double wavelength,
                    double footprint,
                    uint32_t seed) {
  double sum = 0;
  double amplitude = 0.5;
  for (uint32_t octave = 0; octave < 4; ++octave) {
    const double visibility = Visibility(0.5 * wavelength, footprint);
    if (visibility == 0) break;
    sum += visibility * amplitude * SmoothNoise(uv / wavelength, seed + octave);
    wavelength *= 0.5;
    amplitude *= 0.7;
  }
  return sum;
}

Texture FacadeTexture(const Color& color,
                      const Color& accent,
                      const Eigen::Vector2d& size,
                      uint32_t seed) {
  constexpr double kFloorHeight = 3;
  constexpr double kWindowDistance = 2.5;
  const int num_windows =
      std::max(1, Floor((size.x() - 1.2) / kWindowDistance));
  const int num_floors = std::max(1, Floor((size.y() - 0.2) / kFloorHeight));
  return [=](const Eigen::Vector2d& uv, double footprint) -> Color {
    const float weathering = Weathering(uv, footprint, seed);
    const double from_corner = std::min(uv.x(), size.x() - uv.x());
    if (uv.y() < 0.7 || from_corner < (Floor(uv.y() / 0.4) & 1 ? 0.3 : 0.55)) {
      return Color(0.70f, 0.66f, 0.60f) * weathering *
             Masonry(uv, {0.8, 0.4}, footprint, seed + 30);
    }
    if (uv.y() > size.y() - 0.25) return Color(0.85f, 0.82f, 0.76f);
    const int floor = Floor(uv.y() / kFloorHeight);
    const double y = uv.y() - floor * kFloorHeight;
    if (floor > 0 && y < 0.15) return Color(0.82f, 0.78f, 0.72f) * weathering;
    const double column_position =
        (uv.x() - 0.5 * size.x()) / kWindowDistance + 0.5 * num_windows;
    const int column = Floor(column_position);
    const double x = (column_position - column - 0.5) * kWindowDistance;
    if (floor == 0 && column == num_windows / 2) {
      if (std::abs(x) < 0.65 && uv.y() < 2.5) {
        const bool panel = std::abs(std::abs(x) - 0.3) < 0.2 &&
                           std::fmod(uv.y() + 0.2, 0.8) < 0.6;
        return accent * (panel ? 0.75f : 0.55f) * weathering;
      }
    } else if (column >= 0 && column < num_windows && floor < num_floors) {
      Color window;
      if (PaintWindow({x, y - 0.95}, accent, footprint, &window)) return window;
    }
    return color * weathering;
  };
}

Texture StoneTexture(const Color& color,
                     const Eigen::Vector2d& block_size,
                     uint32_t seed) {
  return [=](const Eigen::Vector2d& uv, double footprint) -> Color {
    return color * Weathering(uv, footprint, seed) *
           Masonry(uv, block_size, footprint, seed + 30);
  };
}

Texture PavingTexture(uint32_t seed) {
  return [=](const Eigen::Vector2d& uv, double footprint) -> Color {
    const double radius = uv.norm();
    const bool ring = radius < 17 && std::fmod(radius + 1, 4) < 0.8;
    const Color color =
        ring ? Color(0.62f, 0.50f, 0.42f) : Color(0.66f, 0.63f, 0.58f);
    return color * Weathering(uv, footprint, seed) *
           Masonry(uv, {0.7, 0.5}, footprint, seed + 30);
  };
}

Texture StripeTexture(const Color& color, double width, uint32_t seed) {
  return [=](const Eigen::Vector2d& uv, double footprint) -> Color {
    const bool white = Floor(uv.x() / width) & 1;
    return (white ? Color(0.93f, 0.91f, 0.86f) : color) *
           Weathering(uv, footprint, seed);
  };
}

Texture SpottedTexture(const Color& color, double contrast, uint32_t seed) {
  return [=](const Eigen::Vector2d& uv, double footprint) -> Color {
    const double brightness = FractalNoise(uv, 0.6, footprint, seed) +
                              0.7 * Marks(uv, 0.25, footprint, seed + 10);
    return color * static_cast<float>(1 + contrast * brightness);
  };
}

}  // namespace dgsfm
