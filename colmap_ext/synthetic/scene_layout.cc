#include "colmap_ext/synthetic/scene_layout.h"

#include "colmap_ext/check.h"
#include "colmap_ext/synthetic/facade_layouts.h"
#include "colmap_ext/synthetic/synthetic_camera.h"

#include <algorithm>
#include <cmath>
#include <iterator>
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

template <typename Layout>
std::unique_ptr<SceneLayout> Create(int num_images) {
  return std::make_unique<Layout>(num_images);
}

struct FamilyEntry {
  SceneFamily family;
  const char* name;
  std::unique_ptr<SceneLayout> (*create)(int num_images);
};

constexpr FamilyEntry kFamilies[] = {
    {SceneFamily::RING, "ring", &Create<RingLayout>},
    {SceneFamily::STREET, "street", &Create<StreetLayout>},
    {SceneFamily::FACADE, "facade", &Create<FacadeLayout>},
    {SceneFamily::CLUSTERS, "clusters", &Create<ClustersLayout>},
    {SceneFamily::REPEATS, "repeats", &Create<RepeatsLayout>},
    {SceneFamily::TWINS, "twins", &Create<TwinsLayout>},
    {SceneFamily::LOW_PARALLAX, "low_parallax", &Create<LowParallaxLayout>},
    {SceneFamily::PANORAMA, "panorama", &Create<PanoramaLayout>},
    {SceneFamily::FORWARD, "forward", &Create<ForwardLayout>},
    {SceneFamily::INTERNET, "internet", &Create<InternetLayout>},
};

const FamilyEntry& Entry(SceneFamily family) {
  for (const FamilyEntry& entry : kFamilies) {
    if (entry.family == family) return entry;
  }
  throw std::invalid_argument("unknown scene family");
}

}  // namespace

std::vector<SceneFamily> AllSceneFamilies() {
  std::vector<SceneFamily> families;
  for (const FamilyEntry& entry : kFamilies) families.push_back(entry.family);
  return families;
}

std::string SceneFamilyName(SceneFamily family) { return Entry(family).name; }

SceneFamily SceneFamilyFromName(const std::string& name) {
  for (const FamilyEntry& entry : kFamilies) {
    if (name == entry.name) return entry.family;
  }
  throw std::runtime_error("family '" + name + "' must be " +
                           SceneFamilyNames());
}

std::string SceneFamilyNames() {
  std::string names;
  for (const FamilyEntry& entry : kFamilies) {
    if (!names.empty()) {
      names += &entry == std::end(kFamilies) - 1 ? " or " : ", ";
    }
    names += entry.name;
  }
  return names;
}

std::unique_ptr<SceneLayout> CreateSceneLayout(SceneFamily family,
                                               int num_images) {
  DGSFM_CHECK(num_images > 0) << "num_images = " << num_images;
  return Entry(family).create(num_images);
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
