#include "colmap_ext/synthetic/ray_caster.h"

#include "colmap_ext/check.h"
#include "colmap_ext/parallel.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {

namespace {

constexpr int kTileSize = 16;
// Rays that leave a surface start this far from it [m].
constexpr double kSurfaceOffset = 1e-4;

struct Ray {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;
};

struct Hit {
  double t = std::numeric_limits<double>::infinity();
  const Face* face = nullptr;
  const Sphere* sphere = nullptr;

  bool Found() const { return face != nullptr || sphere != nullptr; }
};

void Intersect(const ConvexSolid& solid, const Ray& ray, Hit* hit) {
  double t_in = 0;
  double t_out = hit->t;
  const Face* face_in = nullptr;
  for (const Face& face : solid.faces) {
    const double speed = face.normal.dot(ray.direction);
    const double distance = face.offset - face.normal.dot(ray.origin);
    if (speed < 0) {
      if (distance < speed * t_in) {
        t_in = distance / speed;
        face_in = &face;
      }
    } else if (speed > 0) {
      t_out = std::min(t_out, distance / speed);
    } else if (distance < 0) {
      return;
    }
    if (t_in >= t_out) return;
  }
  if (face_in == nullptr) return;
  hit->t = t_in;
  hit->face = face_in;
  hit->sphere = nullptr;
}

void Intersect(const Sphere& sphere, const Ray& ray, Hit* hit) {
  const Eigen::Vector3d to_center = sphere.center - ray.origin;
  const double a = ray.direction.squaredNorm();
  const double b = ray.direction.dot(to_center);
  const double c = to_center.squaredNorm() - sphere.radius * sphere.radius;
  const double discriminant = b * b - a * c;
  if (discriminant <= 0) return;
  const double t = (b - std::sqrt(discriminant)) / a;
  if (t <= 0 || t >= hit->t) return;
  hit->t = t;
  hit->face = nullptr;
  hit->sphere = &sphere;
}

bool MissesBound(const ConvexSolid& solid, const Ray& ray) {
  const Eigen::Vector3d to_center = solid.center - ray.origin;
  const double along = to_center.dot(ray.direction);
  const double sq_distance =
      to_center.squaredNorm() - along * along / ray.direction.squaredNorm();
  const bool behind = along < 0 && to_center.norm() > solid.radius;
  return behind || sq_distance > solid.radius * solid.radius;
}

// What a group of rays may meet.
struct Candidates {
  std::vector<const ConvexSolid*> solids;
  std::vector<const Sphere*> spheres;

  Hit Cast(const Ray& ray) const {
    Hit hit;
    for (const ConvexSolid* solid : solids) Intersect(*solid, ray, &hit);
    for (const Sphere* sphere : spheres) Intersect(*sphere, ray, &hit);
    return hit;
  }
};

class Renderer {
 public:
  Renderer(const RenderScene& scene,
           const colmap::Camera& camera,
           const Rigid3d& cam_from_world)
      : scene_(scene),
        camera_(camera),
        center_(cam_from_world.TargetOriginInSource()),
        world_from_cam_(cam_from_world.rotation.conjugate().toRotationMatrix()),
        sun_(scene.direction_to_sun.normalized()) {}

  // t along a ray is z-depth.
  Ray RayOfPixel(double x, double y) const {
    return {center_,
            world_from_cam_ * camera_.ImageToWorld({x, y}).homogeneous()};
  }

  // Surfaces within the cone around the rays of the tile.
  Candidates CandidatesOfTile(int x0, int y0, int x1, int y1) const;

  Eigen::Vector3f Shade(const Candidates& candidates, const Ray& ray) const;

 private:
  bool IsInShadow(const Eigen::Vector3d& point) const;

  const RenderScene& scene_;
  const colmap::Camera& camera_;
  const Eigen::Vector3d center_;
  const Eigen::Matrix3d world_from_cam_;
  const Eigen::Vector3d sun_;
};

Candidates Renderer::CandidatesOfTile(int x0, int y0, int x1, int y1) const {
  const Eigen::Vector3d axis =
      RayOfPixel(0.5 * (x0 + x1), 0.5 * (y0 + y1)).direction.normalized();
  double angle = 0;
  for (const int x : {x0, x1}) {
    for (const int y : {y0, y1}) {
      const Eigen::Vector3d corner = RayOfPixel(x, y).direction.normalized();
      angle = std::max(angle, std::acos(std::min(1., axis.dot(corner))));
    }
  }
  angle *= 1.1;  // edges that distortion bends outwards
  const auto in_cone = [&](const Eigen::Vector3d& center, double radius) {
    const Eigen::Vector3d to_center = center - center_;
    const double distance = to_center.norm();
    if (distance <= radius) return true;
    const double cos_offset =
        std::clamp(axis.dot(to_center) / distance, -1., 1.);
    return std::acos(cos_offset) <= angle + std::asin(radius / distance);
  };
  Candidates candidates;
  for (const ConvexSolid& solid : scene_.solids) {
    if (in_cone(solid.center, solid.radius))
      candidates.solids.push_back(&solid);
  }
  for (const Sphere& sphere : scene_.spheres) {
    if (in_cone(sphere.center, sphere.radius)) {
      candidates.spheres.push_back(&sphere);
    }
  }
  return candidates;
}

bool Renderer::IsInShadow(const Eigen::Vector3d& point) const {
  const Ray ray{point, sun_};
  Hit hit;
  for (const ConvexSolid& solid : scene_.solids) {
    if (!MissesBound(solid, ray)) Intersect(solid, ray, &hit);
    if (hit.Found()) return true;
  }
  for (const Sphere& sphere : scene_.spheres) {
    Intersect(sphere, ray, &hit);
    if (hit.Found()) return true;
  }
  return false;
}

Eigen::Vector3f Renderer::Shade(const Candidates& candidates,
                                const Ray& ray) const {
  const Hit hit = candidates.Cast(ray);
  if (!hit.Found()) {
    const float up = std::clamp(ray.direction.normalized().z(), 0., 1.);
    return Eigen::Vector3f(0.85f, 0.90f, 0.95f) -
           up * Eigen::Vector3f(0.55f, 0.40f, 0.15f);
  }
  const Eigen::Vector3d point = ray.origin + hit.t * ray.direction;
  Eigen::Vector3d normal;
  Eigen::Vector2d uv;
  if (hit.face != nullptr) {
    normal = hit.face->normal;
    const Eigen::Vector3d offset = point - hit.face->origin;
    uv = {hit.face->u_axis.dot(offset), hit.face->v_axis.dot(offset)};
  } else {
    normal = (point - hit.sphere->center) / hit.sphere->radius;
    uv = hit.sphere->radius *
         Eigen::Vector2d(std::atan2(normal.y(), normal.x()),
                         std::asin(std::clamp(normal.z(), -1., 1.)));
  }
  // Width of half a pixel on the surface, larger where it is seen obliquely.
  const double cos_view =
      std::abs(normal.dot(ray.direction)) / ray.direction.norm();
  const double footprint = 0.5 * hit.t / camera_.MeanFocalLength() /
                           std::max(0.05, std::sqrt(cos_view));
  const Texture& texture =
      hit.face != nullptr ? hit.face->texture : hit.sphere->texture;
  double light = 0.48 + 0.08 * normal.z();
  const double cos_sun = normal.dot(sun_);
  if (cos_sun > 0 && !IsInShadow(point + kSurfaceOffset * normal)) {
    light += 0.56 * cos_sun;
  }
  return texture(uv, footprint) * static_cast<float>(light);
}

// Bounding sphere of points that contain the solid's corners.
void SetBound(const std::vector<Eigen::Vector3d>& corners, ConvexSolid* solid) {
  solid->center.setZero();
  for (const Eigen::Vector3d& corner : corners) {
    solid->center += corner / corners.size();
  }
  solid->radius = 0;
  for (const Eigen::Vector3d& corner : corners) {
    solid->radius = std::max(solid->radius, (corner - solid->center).norm());
  }
}

// The face through three corners, counter-clockwise seen from outside, the
// first two being the lower left and right of the texture.
Face FaceOfCorners(const Eigen::Vector3d& lower_left,
                   const Eigen::Vector3d& lower_right,
                   const Eigen::Vector3d& upper,
                   const Texture& texture) {
  Face face;
  face.origin = lower_left;
  face.u_axis = (lower_right - lower_left).normalized();
  face.normal = face.u_axis.cross(upper - lower_left).normalized();
  face.v_axis = face.normal.cross(face.u_axis);
  face.offset = face.normal.dot(lower_left);
  face.texture = texture;
  return face;
}

Eigen::Vector3d Place(const Eigen::Vector3d& base,
                      double yaw_rad,
                      const Eigen::Vector3d& offset) {
  return base + Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()) * offset;
}

}  // namespace

ConvexSolid CreateBox(const Eigen::Vector3d& base,
                      const Eigen::Vector3d& size,
                      double yaw_rad,
                      const Texture& side,
                      const Texture& top) {
  const double signs[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
  std::vector<Eigen::Vector3d> corners;
  for (const double z : {0., size.z()}) {
    for (const auto& [x, y] : signs) {
      corners.push_back(
          Place(base, yaw_rad, {0.5 * x * size.x(), 0.5 * y * size.y(), z}));
    }
  }
  ConvexSolid box;
  for (int i = 0; i < 4; ++i) {
    const int next = (i + 1) % 4;
    box.faces.push_back(
        FaceOfCorners(corners[i], corners[next], corners[4 + i], side));
  }
  box.faces.push_back(FaceOfCorners(corners[4], corners[5], corners[7], top));
  box.faces.push_back(FaceOfCorners(corners[1], corners[0], corners[2], top));
  SetBound(corners, &box);
  return box;
}

ConvexSolid CreateGableRoof(const Eigen::Vector3d& base,
                            const Eigen::Vector3d& size,
                            double yaw_rad,
                            const Texture& roof,
                            const Texture& gable) {
  const Eigen::Vector3d half = 0.5 * size;
  const auto corner = [&](double x, double y, double z) {
    return Place(base, yaw_rad, {x * half.x(), y * half.y(), z * size.z()});
  };
  const Eigen::Vector3d left = corner(-1, 0, 1), right = corner(1, 0, 1);
  const std::vector<Eigen::Vector3d> corners = {corner(-1, -1, 0),
                                                corner(1, -1, 0),
                                                corner(1, 1, 0),
                                                corner(-1, 1, 0),
                                                left,
                                                right};
  ConvexSolid solid;
  solid.faces = {FaceOfCorners(corners[0], corners[1], left, roof),
                 FaceOfCorners(corners[1], corners[2], right, gable),
                 FaceOfCorners(corners[2], corners[3], right, roof),
                 FaceOfCorners(corners[3], corners[0], left, gable),
                 FaceOfCorners(corners[1], corners[0], corners[2], gable)};
  SetBound(corners, &solid);
  return solid;
}

ConvexSolid CreateFrustum(const Eigen::Vector3d& base,
                          double radius,
                          double top_radius,
                          double height,
                          int num_sides,
                          const Texture& side,
                          const Texture& top) {
  DGSFM_CHECK(num_sides >= 3) << num_sides;
  std::vector<Eigen::Vector3d> corners;
  for (const bool is_top : {false, true}) {
    for (int i = 0; i < num_sides; ++i) {
      const double angle = 2 * M_PI * (i + 0.5) / num_sides;
      const Eigen::Vector2d xy(std::cos(angle), std::sin(angle));
      corners.push_back(base);
      corners.back().head<2>() += (is_top ? top_radius : radius) * xy;
      corners.back().z() += is_top ? height : 0;
    }
  }
  ConvexSolid solid;
  for (int i = 0; i < num_sides; ++i) {
    const int next = (i + 1) % num_sides;
    solid.faces.push_back(
        FaceOfCorners(corners[i], corners[next], corners[num_sides + i], side));
  }
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d apex = base + height * up;
  Face top_face;
  top_face.normal = up;
  top_face.offset = apex.z();
  top_face.origin = apex;
  top_face.u_axis = Eigen::Vector3d::UnitX();
  top_face.v_axis = Eigen::Vector3d::UnitY();
  top_face.texture = top;
  Face bottom_face = top_face;
  bottom_face.normal = -up;
  bottom_face.offset = -base.z();
  bottom_face.origin = base;
  solid.faces.push_back(top_face);
  solid.faces.push_back(bottom_face);
  SetBound(corners, &solid);
  return solid;
}

ConvexSolid CreateGround(const Texture& texture) {
  ConvexSolid solid;
  solid.faces = {FaceOfCorners(Eigen::Vector3d::Zero(),
                               Eigen::Vector3d::UnitX(),
                               Eigen::Vector3d::UnitY(),
                               texture)};
  return solid;
}

RenderedImage RenderImage(const RenderScene& scene,
                          const colmap::Camera& camera,
                          const Rigid3d& cam_from_world,
                          int num_threads) {
  const Renderer renderer(scene, camera, cam_from_world);
  const int width = static_cast<int>(camera.Width());
  const int height = static_cast<int>(camera.Height());
  DGSFM_CHECK(width > 0 && height > 0) << "the camera has no size";
  RenderedImage image;
  image.depth_map.width = width;
  image.depth_map.height = height;
  image.depth_map.values.resize(size_t(width) * height);
  DGSFM_CHECK(image.bitmap.Allocate(width, height, true));
  const int num_tiles_x = (width + kTileSize - 1) / kTileSize;
  const int num_tiles_y = (height + kTileSize - 1) / kTileSize;
  ParallelFor(num_tiles_x * num_tiles_y, num_threads, [&](size_t tile) {
    const int x0 = static_cast<int>(tile % num_tiles_x) * kTileSize;
    const int y0 = static_cast<int>(tile / num_tiles_x) * kTileSize;
    const int x1 = std::min(x0 + kTileSize, width);
    const int y1 = std::min(y0 + kTileSize, height);
    const Candidates candidates = renderer.CandidatesOfTile(x0, y0, x1, y1);
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        Eigen::Vector3f color = Eigen::Vector3f::Zero();
        for (const double dy : {0.25, 0.75}) {
          for (const double dx : {0.25, 0.75}) {
            const Ray ray = renderer.RayOfPixel(x + dx, y + dy);
            color += 63.75f * renderer.Shade(candidates, ray);
          }
        }
        const Eigen::Array3f rgb = color.array().round().max(0).min(255);
        image.bitmap.SetPixel(
            x, y, {uint8_t(rgb[0]), uint8_t(rgb[1]), uint8_t(rgb[2])});
        const Hit hit = candidates.Cast(renderer.RayOfPixel(x + 0.5, y + 0.5));
        image.depth_map.values[size_t(y) * width + x] = hit.Found() ? hit.t : 0;
      }
    }
  });
  return image;
}

std::optional<double> CastRay(const RenderScene& scene,
                              const Eigen::Vector3d& origin,
                              const Eigen::Vector3d& direction) {
  const Ray ray{origin, direction};
  Hit hit;
  for (const ConvexSolid& solid : scene.solids) Intersect(solid, ray, &hit);
  for (const Sphere& sphere : scene.spheres) Intersect(sphere, ray, &hit);
  if (!hit.Found()) return std::nullopt;
  return hit.t;
}

}  // namespace dgsfm
