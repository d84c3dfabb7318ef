// Textures of the rendered scenes, computed and not stored: patterns that
// repeat, as on real buildings, under stains and sharp-edged marks that do
// not, so that features match where they should.

#pragma once

#include <cstdint>
#include <functional>

#include <Eigen/Core>

namespace dgsfm {

// Colour, each channel in [0, 1], at a position [m] on a surface. `footprint`
// is the size [m] of what is seen of the surface at once; finer detail is
// faded out, so that distant surfaces do not alias.
using Texture =
    std::function<Eigen::Vector3f(const Eigen::Vector2d& uv, double footprint)>;

// Sum of octaves of smooth noise from `wavelength` [m] down to an eighth of
// it, in [-1, 1], zero on average.
double FractalNoise(const Eigen::Vector2d& uv,
                    double wavelength,
                    double footprint,
                    uint32_t seed);

// A wall of `size` [m] with plaster of `color` and rows of equal windows with
// shutters of `accent`, between corner stones. uv starts at the lower left.
Texture FacadeTexture(const Eigen::Vector3f& color,
                      const Eigen::Vector3f& accent,
                      const Eigen::Vector2d& size,
                      uint32_t seed);
// Courses of blocks of `block_size` [m] with darker joints.
Texture StoneTexture(const Eigen::Vector3f& color,
                     const Eigen::Vector2d& block_size,
                     uint32_t seed);
// Paving stones with rings around the origin.
Texture PavingTexture(uint32_t seed);
// Stripes of `color` and white, `width` [m] each.
Texture StripeTexture(const Eigen::Vector3f& color,
                      double width,
                      uint32_t seed);
// Stained colour with spots: wood, water, leaves.
Texture SpottedTexture(const Eigen::Vector3f& color,
                       double contrast,
                       uint32_t seed);

}  // namespace dgsfm
