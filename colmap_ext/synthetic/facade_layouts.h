// Families of scenes before facades: a plain one, two that are joined weakly,
// and one of bays that look alike.

#pragma once

#include "colmap_ext/synthetic/scene_layout.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// A grid of viewpoints twice as wide as high, 10 to 13 m from the facade.
class FacadeLayout : public SceneLayout {
 public:
  explicit FacadeLayout(int num_images)
      : FacadeLayout(num_images,
                     static_cast<int>(std::ceil(std::sqrt(2. * num_images)))) {}
  FacadeLayout(int num_images, int num_columns)
      : num_columns_(std::max(1, num_columns)),
        num_rows_((num_images + num_columns_ - 1) / num_columns_) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    Eigen::Vector3d xyz;
    xyz.x() = random->Uniform(-4, Width() + 4);
    xyz.y() = random->Uniform(10, 13);
    xyz.z() = random->Uniform(-4, 1.5 * num_rows_ + 2.5);
    return {{xyz, {0, -1, 0}}};
  }

  Viewpoint DrawViewpoint(int i, RandomStream*) const override {
    const Eigen::Vector3d center(
        2. * (i % num_columns_), 0, 1.5 * (i / num_columns_));
    return {center, center + Eigen::Vector3d(0, 10, 0)};
  }

  // Distance between the first and the last column [m].
  double Width() const { return 2. * (num_columns_ - 1); }
  int NumRows() const { return num_rows_; }

 private:
  int num_columns_;
  int num_rows_;
};

// Each of the two images in the middle shares about a third of its view with
// the nearest column of either facade; the facades share none.
class ClustersLayout : public SceneLayout {
 public:
  explicit ClustersLayout(int num_images)
      : num_links_(std::min(2, num_images / 4)),
        num_images1_((num_images - num_links_ + 1) / 2),
        num_images2_(num_images - num_links_ - num_images1_),
        facade1_(num_images1_),
        facade2_(num_images2_),
        wall_(num_images,
              static_cast<int>(facade1_.Width() + kGap + facade2_.Width()) / 2 +
                  1) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    SurfacePoint point = wall_.DrawPoints(random)[0];
    point.xyz.z() = random->Uniform(-4, 1.5 * facade1_.NumRows() + 2.5);
    return {point};
  }

  Viewpoint DrawViewpoint(int i, RandomStream* random) const override {
    if (i < num_images1_) return facade1_.DrawViewpoint(i, random);
    Viewpoint view;
    Eigen::Vector3d shift(facade1_.Width() + kGap, 0, 0);
    if (i < num_images1_ + num_images2_) {
      view = facade2_.DrawViewpoint(i - num_images1_, random);
    } else {
      view = facade1_.DrawViewpoint(0, random);
      shift.x() -= 0.5 * kGap;
      shift.z() = 0.75 * (facade1_.NumRows() - 1);
    }
    view.center += shift;
    view.target += shift;
    return view;
  }

 private:
  // Between the nearest columns of the facades [m]; views are 11 to 15 m wide.
  static constexpr double kGap = 18;

  int num_links_;
  int num_images1_;
  int num_images2_;
  FacadeLayout facade1_;
  FacadeLayout facade2_;
  FacadeLayout wall_;
};

// A long facade of equal bays, in which most points repeat. It has one row of
// images up to some hundred of them, so that it has bays out of sight of each
// other.
class RepeatsLayout : public SceneLayout {
 public:
  explicit RepeatsLayout(int num_images)
      : facade_(num_images,
                static_cast<int>(num_images /
                                 std::max(1., std::sqrt(num_images) / 10))),
        num_bays_(static_cast<int>(facade_.Width() / kBayWidth) + 3) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    // A draw that repeats makes a point in every bay.
    const bool repeats =
        random->Uniform() <
        kRepeatedShare / (kRepeatedShare + num_bays_ * (1 - kRepeatedShare));
    SurfacePoint point = facade_.DrawPoints(random)[0];
    if (!repeats) return {point};
    point.xyz.x() = random->Uniform(-kBayWidth, 0);
    std::vector<SurfacePoint> points(num_bays_, point);
    for (int i = 0; i < num_bays_; ++i) points[i].xyz.x() += i * kBayWidth;
    return points;
  }

  Viewpoint DrawViewpoint(int i, RandomStream* random) const override {
    return facade_.DrawViewpoint(i, random);
  }

 private:
  static constexpr double kBayWidth = 4;  // [m]
  // Share of all points that repeat.
  static constexpr double kRepeatedShare = 0.7;

  FacadeLayout facade_;
  int num_bays_;
};

}  // namespace dgsfm
