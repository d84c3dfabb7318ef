#include "colmap_ext/synthetic/town_scene.h"

#include "colmap_ext/check.h"
#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/random_stream.h"
#include "colmap_ext/synthetic/synthetic_camera.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <stdexcept>
#include <utility>

namespace dgsfm {

namespace {

using Color = Eigen::Vector3f;

constexpr uint32_t kTownPurpose = 300;
constexpr uint32_t kViewPurpose = 301;
// Distance of the houses' fronts from the middle of the square [m].
constexpr double kHalfSquare = 18;
constexpr double kHouseDepth = 8;

const Color kPlasterColors[] = {{0.93f, 0.76f, 0.47f},   // ochre
                                {0.80f, 0.47f, 0.38f},   // terracotta
                                {0.60f, 0.72f, 0.80f},   // pale blue
                                {0.91f, 0.87f, 0.74f},   // cream
                                {0.66f, 0.76f, 0.60f},   // sage
                                {0.88f, 0.65f, 0.63f}};  // rose
const Color kAccentColors[] = {{0.22f, 0.42f, 0.33f},    // green
                               {0.25f, 0.37f, 0.55f},    // blue
                               {0.55f, 0.23f, 0.18f},    // red
                               {0.45f, 0.33f, 0.22f}};   // brown

class TownBuilder {
 public:
  explicit TownBuilder(uint32_t random_seed)
      : random_(random_seed, kTownPurpose) {}

  RenderScene Build() {
    scene_.solids.push_back(CreateGround(PavingTexture(NewSeed())));
    AddHouses();
    AddTower({9, 32, 0});
    AddFountain();
    for (const double x : {-6., 6.}) AddStall({x, -2.5, 0}, 0.2);
    for (const double x : {-3.2, 3.2}) AddStall({x, -6.2, 0}, -0.15);
    for (const double x : {-14.5, -9.5, 9.5, 14.5}) {
      AddTree({x, 15, 0});
      AddTree({x, -15.2, 0});
    }
    for (const double angle : {0.25, 0.75, 1.25, 1.75}) {
      AddLamp(14 * Eigen::Vector3d(
                       std::cos(M_PI * angle), std::sin(M_PI * angle), 0));
    }
    return std::move(scene_);
  }

 private:
  uint32_t NewSeed() { return 1000 * ++num_seeds_ + random_.Index(1000); }

  void AddHouse(const Eigen::Vector3d& front, double width, double yaw_rad) {
    const double height = 6.5 + 3 * random_.Index(2) + random_.Uniform(0, 0.6);
    const Color& color = kPlasterColors[num_houses_ % 6];
    const Color& accent = kAccentColors[num_houses_ % 4];
    // Steps of 5 keep neighbours different, and let looks come again.
    num_houses_ += 5;
    const Eigen::Vector3d base =
        front + Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()) *
                    Eigen::Vector3d(0, 0.5 * kHouseDepth, 0);
    const Texture wall =
        FacadeTexture(color, accent, {width, height}, NewSeed());
    const Texture tiles =
        StoneTexture(Color(0.70f, 0.40f, 0.31f), {0.45, 0.35}, NewSeed());
    scene_.solids.push_back(
        CreateBox(base, {width, kHouseDepth, height}, yaw_rad, wall, tiles));
    const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
    const double roof_height = random_.Uniform(2.2, 3.2);
    scene_.solids.push_back(
        CreateGableRoof(base + height * up,
                        {width, kHouseDepth + 0.8, roof_height},
                        yaw_rad,
                        tiles,
                        SpottedTexture(color, 0.35, NewSeed())));
    const Texture brick =
        StoneTexture(Color(0.62f, 0.40f, 0.33f), {0.3, 0.15}, NewSeed());
    const Eigen::Vector3d offset{random_.Uniform(-0.3, 0.3) * width, -1.2, 0};
    scene_.solids.push_back(
        CreateBox(base + (height + 0.4 * roof_height) * up +
                      Eigen::AngleAxisd(yaw_rad, up) * offset,
                  {0.8, 0.8, 0.6 * roof_height + 0.5},
                  yaw_rad,
                  brick,
                  brick));
  }

  // Houses side by side, their fronts on the line from `begin` to `end`, which
  // is seen from its right.
  void AddRow(const Eigen::Vector3d& begin,
              const Eigen::Vector3d& end,
              int num_houses) {
    const Eigen::Vector3d step = (end - begin) / num_houses;
    const double yaw_rad = std::atan2(step.y(), step.x());
    for (int i = 0; i < num_houses; ++i) {
      AddHouse(begin + (i + 0.5) * step, step.norm(), yaw_rad);
    }
  }

  void AddHouses() {
    const double a = kHalfSquare;
    AddRow({-a, a, 0}, {a, a, 0}, 5);    // north
    AddRow({a, a, 0}, {a, -a, 0}, 5);    // east
    AddRow({a, -a, 0}, {-a, -a, 0}, 5);  // south
    // The street leaves to the west.
    AddRow({-a, -a, 0}, {-a, -5, 0}, 2);
    AddRow({-a, 5, 0}, {-a, a, 0}, 2);
    const double b = a + kHouseDepth;
    AddRow({-b - 42, 5, 0}, {-b, 5, 0}, 6);
    AddRow({-b, -5, 0}, {-b - 42, -5, 0}, 6);
    AddHouse({-b - 44, 0, 0}, 12, M_PI / 2);
  }

  void AddTower(const Eigen::Vector3d& base) {
    const Texture stone =
        StoneTexture(Color(0.82f, 0.74f, 0.62f), {0.9, 0.45}, NewSeed());
    const Texture wall = FacadeTexture(
        Color(0.85f, 0.78f, 0.66f), kAccentColors[3], {6, 14}, NewSeed());
    scene_.solids.push_back(CreateBox(base, {6, 6, 14}, 0, wall, stone));
    const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
    scene_.solids.push_back(
        CreateBox(base + 14 * up, {6.8, 6.8, 0.6}, 0, stone, stone));
    scene_.solids.push_back(
        CreateBox(base + 14.6 * up, {4.6, 4.6, 3.2}, 0, stone, stone));
    const Texture slate =
        StoneTexture(Color(0.36f, 0.47f, 0.50f), {0.5, 0.4}, NewSeed());
    scene_.solids.push_back(
        CreateFrustum(base + 17.8 * up, 3.6, 0, 6, 8, slate, slate));
  }

  void AddFountain() {
    const Texture stone =
        StoneTexture(Color(0.80f, 0.77f, 0.70f), {0.8, 0.35}, NewSeed());
    const Texture water =
        SpottedTexture(Color(0.30f, 0.52f, 0.58f), 0.35, NewSeed());
    const Texture basin = [=](const Eigen::Vector2d& uv, double footprint) {
      return uv.norm() > 2.6 ? stone(uv, footprint) : water(uv, footprint);
    };
    scene_.solids.push_back(
        CreateFrustum({0, 0, 0}, 3.3, 3.1, 0.8, 12, stone, basin));
    scene_.solids.push_back(
        CreateFrustum({0, 0, 0.8}, 0.55, 0.4, 1.6, 8, stone, stone));
    scene_.solids.push_back(
        CreateFrustum({0, 0, 2.4}, 0.5, 1.5, 0.45, 12, stone, water));
    scene_.solids.push_back(
        CreateFrustum({0, 0, 2.85}, 0.3, 0.2, 1.1, 8, stone, stone));
    const Texture bronze =
        SpottedTexture(Color(0.55f, 0.45f, 0.25f), 0.6, NewSeed());
    scene_.spheres.push_back({{0, 0, 4.3}, 0.45, bronze});
  }

  void AddStall(const Eigen::Vector3d& base, double yaw_rad) {
    const Texture wood =
        SpottedTexture(Color(0.60f, 0.44f, 0.28f), 0.5, NewSeed());
    const Texture goods =
        SpottedTexture(Color(0.75f, 0.50f, 0.22f), 0.9, NewSeed());
    const Texture cloth =
        StripeTexture(kAccentColors[1 + num_stalls_++ % 2], 0.35, NewSeed());
    scene_.solids.push_back(
        CreateBox(base, {2.4, 1.2, 0.95}, yaw_rad, wood, goods));
    const Eigen::AngleAxisd turn(yaw_rad, Eigen::Vector3d::UnitZ());
    for (const double x : {-1.2, 1.2}) {
      for (const double y : {-0.75, 0.75}) {
        scene_.solids.push_back(
            CreateBox(base + turn * Eigen::Vector3d(x, y, 0),
                      {0.08, 0.08, 2.2},
                      yaw_rad,
                      wood,
                      wood));
      }
    }
    scene_.solids.push_back(CreateGableRoof(base + Eigen::Vector3d(0, 0, 2.2),
                                            {2.8, 1.9, 0.7},
                                            yaw_rad,
                                            cloth,
                                            cloth));
  }

  void AddTree(const Eigen::Vector3d& base) {
    const Texture bark =
        SpottedTexture(Color(0.42f, 0.32f, 0.24f), 0.6, NewSeed());
    const Texture leaves =
        SpottedTexture(Color(0.36f, 0.50f, 0.22f), 0.9, NewSeed());
    scene_.solids.push_back(
        CreateFrustum(base, 0.22, 0.15, 2.6, 8, bark, bark));
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector3d offset{random_.Uniform(-0.7, 0.7),
                                   random_.Uniform(-0.7, 0.7),
                                   random_.Uniform(2.6, 3.9)};
      scene_.spheres.push_back(
          {base + offset, random_.Uniform(0.8, 1.2), leaves});
    }
  }

  void AddLamp(const Eigen::Vector3d& base) {
    const Texture iron =
        SpottedTexture(Color(0.22f, 0.24f, 0.25f), 0.4, NewSeed());
    const Texture glass =
        SpottedTexture(Color(0.95f, 0.90f, 0.72f), 0.15, NewSeed());
    scene_.solids.push_back(CreateFrustum(base, 0.1, 0.06, 3.4, 6, iron, iron));
    scene_.spheres.push_back({base + Eigen::Vector3d(0, 0, 3.6), 0.25, glass});
  }

  RandomStream random_;
  RenderScene scene_;
  uint32_t num_seeds_ = 0;
  int num_houses_ = 0;
  int num_stalls_ = 0;
};

// Whether the image sees a point of the world; gives its position.
bool SeesPoint(const RenderScene& scene,
               const colmap::Camera& camera,
               const Rigid3d& cam_from_world,
               const Eigen::Vector3d& point,
               Eigen::Vector2d* xy) {
  if (!ProjectIntoImage(camera, cam_from_world * point, 0.1, xy)) return false;
  const Eigen::Vector3d center = cam_from_world.TargetOriginInSource();
  const std::optional<double> t = CastRay(scene, center, point - center);
  // The ray reaches the point at t = 1; less is an occluder.
  return t && std::abs(*t - 1) < 1e-6;
}

}  // namespace

RenderScene CreateTown(uint32_t random_seed) {
  return TownBuilder(random_seed).Build();
}

std::vector<Rigid3d> CreateTownViews(SceneFamily family,
                                     int num_images,
                                     uint32_t random_seed) {
  DGSFM_CHECK(num_images > 0) << "num_images = " << num_images;
  std::vector<Rigid3d> views;
  for (int i = 0; i < num_images; ++i) {
    RandomStream random(random_seed, kViewPurpose, i);
    Eigen::Vector3d center, target;
    if (family == SceneFamily::RING) {
      const double azimuth = 2 * M_PI * i / num_images - M_PI / 2;
      center = {12 * std::cos(azimuth), 12 * std::sin(azimuth), 3.6};
      target = {0, 0, 4};
    } else if (family == SceneFamily::STREET) {
      center = {-62 + std::min(1.5, 50. / num_images) * i, 0, 1.8};
      target = center + Eigen::Vector3d(20, 0, 1.2);
    } else if (family == SceneFamily::FACADE) {
      const int num_columns = (num_images + 1) / 2;
      const double column = i % num_columns;
      center = {(column + 0.5) * 24 / num_columns - 12, 5, 1.8};
      if (i >= num_columns) center.z() = 4;
      target = center + Eigen::Vector3d(0, 13, 1);
    } else {
      throw std::runtime_error("images of the family '" +
                               SceneFamilyName(family) +
                               "' cannot be rendered, only observed in a "
                               "database; ring, street and facade can");
    }
    for (int k = 0; k < 3; ++k) {
      center(k) += random.Uniform(-0.25, 0.25);
      target(k) += random.Uniform(-0.5, 0.5);
    }
    views.push_back(LookAt(center, target));
  }
  return views;
}

colmap::Reconstruction CreateTownModel(const SyntheticSceneOptions& options) {
  colmap::Reconstruction model;
  const auto cameras = SynthesizeCameras(
      options.camera, options.num_images, options.random_seed);
  for (const auto& [camera_id, camera] : cameras) model.AddCamera(camera);
  const std::vector<Rigid3d> views =
      CreateTownViews(options.family, options.num_images, options.random_seed);
  for (int i = 0; i < options.num_images; ++i) {
    colmap::Image image;
    image.SetImageId(i + 1);
    image.SetCameraId(1 + i % cameras.size());
    char name[32];
    std::snprintf(name, sizeof(name), "image%04d.jpg", i);
    image.SetName(name);
    SetCamFromWorld(views[i], &image);
    model.AddImage(image);
    model.RegisterImage(image.ImageId());
  }
  return model;
}

void AddSurfacePoints(const RenderScene& scene,
                      int num_points_per_image,
                      colmap::Reconstruction* model) {
  std::vector<colmap::image_t> image_ids = model->RegImageIds();
  std::sort(image_ids.begin(), image_ids.end());
  std::vector<Eigen::Vector3d> points;
  std::vector<colmap::Track> tracks;
  std::map<colmap::image_t, std::vector<Eigen::Vector2d>> points2D;
  for (const colmap::image_t image_id : image_ids) {
    const colmap::Image& image = model->Image(image_id);
    const colmap::Camera& camera = model->Camera(image.CameraId());
    const Rigid3d world_from_cam = CamFromWorld(image).Inverse();
    const double step = std::sqrt(double(camera.Width()) * camera.Height() /
                                  num_points_per_image);
    for (double y = 0.5 * step; y < camera.Height(); y += step) {
      for (double x = 0.5 * step; x < camera.Width(); x += step) {
        const Eigen::Vector3d direction =
            world_from_cam.rotation * camera.ImageToWorld({x, y}).homogeneous();
        const std::optional<double> depth =
            CastRay(scene, world_from_cam.translation, direction);
        if (!depth) continue;
        const Eigen::Vector3d point =
            world_from_cam.translation + *depth * direction;
        std::vector<std::pair<colmap::image_t, Eigen::Vector2d>> seen;
        for (const colmap::image_t other_id : image_ids) {
          const colmap::Image& other = model->Image(other_id);
          Eigen::Vector2d xy;
          if (SeesPoint(scene,
                        model->Camera(other.CameraId()),
                        CamFromWorld(other),
                        point,
                        &xy)) {
            seen.emplace_back(other_id, xy);
          }
        }
        if (seen.size() < 2) continue;
        points.push_back(point);
        colmap::Track& track = tracks.emplace_back();
        for (const auto& [other_id, xy] : seen) {
          track.AddElement(other_id, points2D[other_id].size());
          points2D[other_id].push_back(xy);
        }
      }
    }
  }
  for (const auto& [image_id, xys] : points2D) {
    model->Image(image_id).SetPoints2D(xys);
  }
  for (size_t i = 0; i < points.size(); ++i) {
    model->AddPoint3D(points[i], tracks[i]);
  }
}

}  // namespace dgsfm
