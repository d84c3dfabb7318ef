#include "colmap_ext/synthetic/scene_layout.h"

#include "colmap_ext/check.h"
#include "colmap_ext/synthetic/synthetic_camera.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace dgsfm {

namespace {

// How far surfaces reach beyond the end of a path [m]: as far as one sees.
constexpr double kVisibleAhead = 40;

// The ring grows beyond 40 images, and the object with it.
class RingLayout : public SceneLayout {
 public:
  explicit RingLayout(int num_images)
      : num_images_(num_images),
        inner_(12 * std::max(0., num_images / 40. - 1)) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    const double azimuth = random->Uniform(0, 2 * M_PI);
    const Eigen::Vector3d normal(std::cos(azimuth), std::sin(azimuth), 0);
    Eigen::Vector3d xyz = (inner_ + random->Uniform(2.5, 4)) * normal;
    xyz.z() = random->Uniform(-3, 3);
    return {{xyz, normal}};
  }

  Viewpoint DrawViewpoint(int i, RandomStream*) const override {
    const double azimuth = 2 * M_PI * i / num_images_;
    const Eigen::Vector3d outwards(std::cos(azimuth), std::sin(azimuth), 0);
    return {(inner_ + 12) * outwards + Eigen::Vector3d::UnitZ(),
            inner_ * outwards};
  }

 private:
  int num_images_;
  double inner_;  // radius of what the cameras look at [m]
};

class StreetLayout : public SceneLayout {
 public:
  explicit StreetLayout(int num_images) : num_images_(num_images) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    const double side = random->Uniform() < 0.5 ? -1 : 1;
    Eigen::Vector3d xyz;
    xyz.x() = random->Uniform(2, kStep * num_images_ + kVisibleAhead);
    xyz.y() = side * random->Uniform(5, 9);
    xyz.z() = random->Uniform(-1.5, 6);
    return {{xyz, Eigen::Vector3d(-1, -0.5 * side, 0).normalized()}};
  }

  Viewpoint DrawViewpoint(int i, RandomStream*) const override {
    const Eigen::Vector3d center(kStep * i, 0, 0);
    return {center, center + Eigen::Vector3d(10, 0, 0)};
  }

 private:
  static constexpr double kStep = 1.5;  // [m]

  int num_images_;
};

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

// Around a round building whose front and back are the same; what lies between
// them differs. Only the way around tells front from back.
class TwinsLayout : public RingLayout {
 public:
  using RingLayout::RingLayout;

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    const SurfacePoint point = RingLayout::DrawPoints(random)[0];
    if (std::abs(point.normal.y()) < kMinCosFront) return {point};
    // Each of them is drawn, so that one of two becomes a pair.
    if (point.normal.y() > 0) return {};
    SurfacePoint twin = point;
    twin.xyz.head<2>() *= -1;
    twin.normal.head<2>() *= -1;
    return {point, twin};
  }

 private:
  // Front and back reach 45 degrees to either side.
  static constexpr double kMinCosFront = M_SQRT1_2;
};

// Neighbouring views have baselines of a hundredth of the depth.
class LowParallaxLayout : public SceneLayout {
 public:
  explicit LowParallaxLayout(int num_images) : num_images_(num_images) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    const double azimuth = random->Uniform(0, 2 * M_PI);
    const Eigen::Vector3d outwards(std::cos(azimuth), std::sin(azimuth), 0);
    Eigen::Vector3d xyz = random->Uniform(8, 14) * outwards;
    xyz.x() += random->Uniform(0, kStep * num_images_);
    xyz.z() = random->Uniform(-4, 4);
    SurfacePoint point{xyz, -outwards};
    point.max_distance = 20;
    return {point};
  }

  Viewpoint DrawViewpoint(int i, RandomStream*) const override {
    const double azimuth = kTurn * i;
    const Eigen::Vector3d center(kStep * i, 0, 0);
    return {
        center,
        center + 10 * Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0),
        /*center_jitter=*/0.02};
  }

 private:
  static constexpr double kStep = 0.1;        // [m]
  static constexpr double kTurn = M_PI / 18;  // [rad]

  int num_images_;
};

// From one place in the middle of a round wall, in a full turn.
class PanoramaLayout : public SceneLayout {
 public:
  explicit PanoramaLayout(int num_images) : num_images_(num_images) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    const double azimuth = random->Uniform(0, 2 * M_PI);
    const Eigen::Vector3d outwards(std::cos(azimuth), std::sin(azimuth), 0);
    Eigen::Vector3d xyz = random->Uniform(8, 14) * outwards;
    xyz.z() = random->Uniform(-4, 4);
    return {{xyz, -outwards}};
  }

  Viewpoint DrawViewpoint(int i, RandomStream*) const override {
    const double azimuth = 2 * M_PI * i / num_images_;
    return {Eigen::Vector3d::Zero(),
            10 * Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0),
            /*center_jitter=*/0};
  }

 private:
  int num_images_;
};

class ForwardLayout : public SceneLayout {
 public:
  explicit ForwardLayout(int num_images) : num_images_(num_images) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    // Walls, floor and ceiling.
    Eigen::Vector3d across = Eigen::Vector3d::UnitY();
    Eigen::Vector3d along = Eigen::Vector3d::UnitZ();
    if (random->Uniform() < 0.5) std::swap(across, along);
    if (random->Uniform() < 0.5) across *= -1;
    const double x = random->Uniform(2, kStep * num_images_ + kVisibleAhead);
    const double distance = random->Uniform(3, 4.5);
    const double offset = random->Uniform(-3, 3);
    return {{x * Eigen::Vector3d::UnitX() + distance * across + offset * along,
             (-Eigen::Vector3d::UnitX() - 0.5 * across).normalized()}};
  }

  Viewpoint DrawViewpoint(int i, RandomStream*) const override {
    const Eigen::Vector3d center(kStep * i, 0, 0);
    return {center,
            center + Eigen::Vector3d(20, 0, 0),
            /*center_jitter=*/0.02};
  }

 private:
  static constexpr double kStep = 0.5;  // [m]

  int num_images_;
};

// A front of landmarks every 40 m, one per hundred images. Most photographers
// stand before a landmark and look at it, the others anywhere along the front.
// Points are drawn as the photographers see them, so that close-ups have as
// many as wide views.
class InternetLayout : public SceneLayout {
 public:
  explicit InternetLayout(int num_images)
      : num_landmarks_((num_images + 99) / 100) {}

  std::vector<SurfacePoint> DrawPoints(RandomStream* random) const override {
    const Viewpoint view = DrawViewpoint(0, random);
    const double spread = 0.25 * (view.target - view.center).norm();
    SurfacePoint point;
    point.xyz = {view.target.x() + spread * random->Normal(),
                 random->Uniform(0, 4),
                 std::abs(view.target.z() + spread * random->Normal())};
    point.normal =
        Eigen::Vector3d(random->Uniform(-0.7, 0.7), -1, 0).normalized();
    const double distance = (point.xyz - view.center).norm();
    point.min_distance = distance / 2;
    point.max_distance = distance * 2;
    return {point};
  }

  Viewpoint DrawViewpoint(int, RandomStream* random) const override {
    const double landmark_x = kSpacing * random->Index(num_landmarks_);
    const double distance =
        std::exp(random->Uniform(std::log(10.), std::log(40.)));
    const double height =
        random->Uniform() < 0.1 ? random->Uniform(3, 12) : 1.7;
    Eigen::Vector3d center(landmark_x, -distance, height);
    Eigen::Vector3d target(landmark_x, 0, random->Uniform(2, 10));
    if (random->Uniform() < 0.75) {
      center.x() += 0.4 * distance * random->Normal();
      target.x() += 3 * random->Normal();
    } else {
      center.x() += kSpacing * random->Uniform(-0.5, 0.5);
      target.x() = center.x() + 0.3 * distance * random->Normal();
    }
    return {center, target};
  }

 private:
  static constexpr double kSpacing = 40;  // [m]

  size_t num_landmarks_;
};

}  // namespace

const std::vector<SceneFamily>& AllSceneFamilies() {
  static const std::vector<SceneFamily> families = {SceneFamily::RING,
                                                    SceneFamily::STREET,
                                                    SceneFamily::FACADE,
                                                    SceneFamily::CLUSTERS,
                                                    SceneFamily::REPEATS,
                                                    SceneFamily::TWINS,
                                                    SceneFamily::LOW_PARALLAX,
                                                    SceneFamily::PANORAMA,
                                                    SceneFamily::FORWARD,
                                                    SceneFamily::INTERNET};
  return families;
}

std::string SceneFamilyName(SceneFamily family) {
  switch (family) {
    case SceneFamily::RING:
      return "ring";
    case SceneFamily::STREET:
      return "street";
    case SceneFamily::FACADE:
      return "facade";
    case SceneFamily::CLUSTERS:
      return "clusters";
    case SceneFamily::REPEATS:
      return "repeats";
    case SceneFamily::TWINS:
      return "twins";
    case SceneFamily::LOW_PARALLAX:
      return "low_parallax";
    case SceneFamily::PANORAMA:
      return "panorama";
    case SceneFamily::FORWARD:
      return "forward";
    case SceneFamily::INTERNET:
      return "internet";
  }
  throw std::invalid_argument("unknown scene family");
}

SceneFamily SceneFamilyFromName(const std::string& name) {
  for (const SceneFamily family : AllSceneFamilies()) {
    if (name == SceneFamilyName(family)) return family;
  }
  throw std::runtime_error("family '" + name + "' must be " +
                           SceneFamilyNames());
}

std::string SceneFamilyNames() {
  std::string names;
  for (const SceneFamily family : AllSceneFamilies()) {
    if (!names.empty()) {
      names += family == AllSceneFamilies().back() ? " or " : ", ";
    }
    names += SceneFamilyName(family);
  }
  return names;
}

std::unique_ptr<SceneLayout> CreateSceneLayout(SceneFamily family,
                                               int num_images) {
  DGSFM_CHECK(num_images > 0) << "num_images = " << num_images;
  switch (family) {
    case SceneFamily::RING:
      return std::make_unique<RingLayout>(num_images);
    case SceneFamily::STREET:
      return std::make_unique<StreetLayout>(num_images);
    case SceneFamily::FACADE:
      return std::make_unique<FacadeLayout>(num_images);
    case SceneFamily::CLUSTERS:
      return std::make_unique<ClustersLayout>(num_images);
    case SceneFamily::REPEATS:
      return std::make_unique<RepeatsLayout>(num_images);
    case SceneFamily::TWINS:
      return std::make_unique<TwinsLayout>(num_images);
    case SceneFamily::LOW_PARALLAX:
      return std::make_unique<LowParallaxLayout>(num_images);
    case SceneFamily::PANORAMA:
      return std::make_unique<PanoramaLayout>(num_images);
    case SceneFamily::FORWARD:
      return std::make_unique<ForwardLayout>(num_images);
    case SceneFamily::INTERNET:
      return std::make_unique<InternetLayout>(num_images);
  }
  throw std::invalid_argument("unknown scene family");
}

Rigid3d DrawPose(const SceneLayout& layout, int i, RandomStream* random) {
  Viewpoint view = layout.DrawViewpoint(i, random);
  for (int k = 0; k < 3; ++k) {
    view.center(k) += view.center_jitter * random->Uniform(-1, 1);
    view.target(k) += view.target_jitter * random->Uniform(-1, 1);
  }
  const Eigen::Quaterniond roll(Eigen::AngleAxisd(random->Uniform(-0.05, 0.05),
                                                  Eigen::Vector3d::UnitZ()));
  return Rigid3d(roll, Eigen::Vector3d::Zero()) *
         LookAt(view.center, view.target);
}

}  // namespace dgsfm
