#include "controllers/model_renderer.h"

#include "colmap_ext/check.h"
#include "colmap_ext/formats/picture_file.h"
#include "controllers/commands/command_options.h"
#include "controllers/commands/commands.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <iterator>
#include <limits>
#include <new>
#include <stdexcept>

#include <Eigen/Geometry>
#include <FreeImage.h>

namespace dgsfm {
namespace {

using Segment = std::array<Eigen::Vector3d, 2>;

const Eigen::Vector3d kBackground(22, 25, 32);
const Eigen::Vector3d kFrustumColor(255, 112, 67);
const Eigen::Vector3d kColorOfUncoloured(200, 205, 215);

// Subpixels per pixel and direction: averaging them smooths all edges.
constexpr int kOversampling = 3;
constexpr double kFocalPerHeight = 1.2;  // vertical field of view of 45 deg
constexpr double kMargin = 0.06;         // on each side, of the picture
constexpr double kTiltDeg = 22;          // of the view, downwards
constexpr double kTurnDeg = 18;          // away from straight behind
constexpr double kGamma = 0.7;           // below 1 brightens the points
constexpr double kTailRatio = 0.03;      // of points ignored at each end

// Picture with depth, of oversampled resolution.
class Canvas {
 public:
  Canvas(int width, int height)
      : width_(width * kOversampling),
        height_(height * kOversampling),
        depths_(size_t(width_) * height_,
                std::numeric_limits<float>::infinity()) {
    if (!bitmap_.Allocate(width_, height_, /*as_rgb=*/true)) {
      throw std::runtime_error("cannot allocate a picture of this size");
    }
    bitmap_.Fill(ToPixel(kBackground));
  }

  // Centre and radius in pixels of the picture.
  void DrawDisc(const Eigen::Vector2d& center_px,
                double radius_px,
                double depth,
                const Eigen::Vector3d& color) {
    const Eigen::Vector2d center = kOversampling * center_px;
    const double radius = kOversampling * radius_px;
    // Clamped before the conversion: far outside is beyond the int range.
    const auto first = [radius](double x, int end) {
      return static_cast<int>(std::clamp<double>(x - radius, 0, end));
    };
    const auto last = [radius](double x, int end) {
      return static_cast<int>(std::clamp<double>(x + radius + 1, 0, end));
    };
    for (int y = first(center.y(), height_); y < last(center.y(), height_);
         ++y) {
      for (int x = first(center.x(), width_); x < last(center.x(), width_);
           ++x) {
        const Eigen::Vector2d pixel(x + 0.5, y + 0.5);
        const size_t i = size_t(y) * width_ + x;
        if ((pixel - center).squaredNorm() > radius * radius ||
            depth >= depths_[i]) {
          continue;
        }
        depths_[i] = depth;
        bitmap_.SetPixel(x, y, ToPixel(color));
      }
    }
  }

  // Means of the subpixels.
  colmap::Bitmap ToBitmap() const {
    FIBITMAP* means = FreeImage_Rescale(const_cast<FIBITMAP*>(bitmap_.Data()),
                                        width_ / kOversampling,
                                        height_ / kOversampling,
                                        FILTER_BOX);
    if (means == nullptr) throw std::bad_alloc();
    return colmap::Bitmap(means);
  }

 private:
  static colmap::BitmapColor<uint8_t> ToPixel(const Eigen::Vector3d& color) {
    return colmap::BitmapColor<uint8_t>(
        std::lround(color(0)), std::lround(color(1)), std::lround(color(2)));
  }

  int width_;
  int height_;
  colmap::Bitmap bitmap_;
  std::vector<float> depths_;
};

// Pinhole view; x right, y down, z forward, as of a COLMAP camera.
struct View {
  Eigen::Matrix3d view_from_world;  // rotation
  Eigen::Vector3d center_in_view;
  double distance = 1;  // from the nearest of what is framed [world units]
  double focal_px = 1;
  Eigen::Vector2d principal_point_px;

  Eigen::Vector3d ToView(const Eigen::Vector3d& xyz) const {
    return view_from_world * xyz - center_in_view;
  }
  Eigen::Vector2d ToPixel(const Eigen::Vector3d& xyz_in_view) const {
    return focal_px * xyz_in_view.hnormalized() + principal_point_px;
  }
};

// `fallback` where the vector has no direction.
Eigen::Vector3d NormalizedOr(const Eigen::Vector3d& vector,
                             const Eigen::Vector3d& fallback) {
  return vector.norm() > 1e-6 ? vector.normalized() : fallback;
}

// From behind and above the cameras. They may look at a common middle from
// all sides: then as the first of them looks.
Eigen::Matrix3d ChooseRotation(
    const std::map<std::string, ModelImage>& images) {
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  Eigen::Vector3d forward = Eigen::Vector3d::Zero();
  for (const auto& [name, image] : images) {
    const Eigen::Matrix3d cam_from_world =
        image.cam_from_world.rotation.toRotationMatrix();
    down += cam_from_world.row(1);
    forward += cam_from_world.row(2);
  }
  const Eigen::Matrix3d first =
      images.begin()->second.cam_from_world.rotation.toRotationMatrix();
  down = NormalizedOr(down, first.row(1));
  const auto level = [&down](const Eigen::Vector3d& vector) {
    return Eigen::Vector3d(vector - vector.dot(down) * down);
  };
  forward = level(forward / images.size());
  if (forward.norm() < 0.1) forward = level(first.row(2));
  forward = NormalizedOr(forward, down.unitOrthogonal());

  const double rad_from_deg = M_PI / 180;
  Eigen::Matrix3d level_from_world;
  level_from_world << down.cross(forward).transpose(), down.transpose(),
      forward.transpose();
  return Eigen::AngleAxisd(kTiltDeg * rad_from_deg, Eigen::Vector3d::UnitX()) *
         Eigen::AngleAxisd(kTurnDeg * rad_from_deg, Eigen::Vector3d::UnitY()) *
         level_from_world;
}

// Leaves out the tails of the points along each of the axes.
std::vector<Eigen::Vector3d> WithoutTails(
    const std::vector<Eigen::Vector3d>& points) {
  Eigen::AlignedBox3d box;
  const size_t num_tail = kTailRatio * points.size();
  std::vector<double> values(points.size());
  for (int axis = 0; axis < 3 && !points.empty(); ++axis) {
    for (size_t i = 0; i < points.size(); ++i) values[i] = points[i](axis);
    std::sort(values.begin(), values.end());
    box.min()(axis) = values[num_tail];
    box.max()(axis) = values[values.size() - 1 - num_tail];
  }
  std::vector<Eigen::Vector3d> kept;
  std::copy_if(points.begin(),
               points.end(),
               std::back_inserter(kept),
               [&box](const auto& point) { return box.contains(point); });
  return kept;
}

// Largest extent along an axis; 1 for a single point or none.
double Extent(const std::vector<Eigen::Vector3d>& points) {
  if (points.empty()) return 1;
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& point : points) box.extend(point);
  const double extent = box.sizes().maxCoeff();
  return extent > 0 ? extent : 1;
}

// Edges of the pyramid from the centre to the image at z = depth, in world.
std::vector<Segment> FrustumEdges(const ModelImage& image,
                                  const colmap::Camera* camera,
                                  double depth) {
  Eigen::Vector2d half_size(0.5, 0.375);
  if (camera != nullptr && camera->MeanFocalLength() > 0 &&
      camera->Width() > 0 && camera->Height() > 0) {
    half_size = Eigen::Vector2d(camera->Width(), camera->Height()) /
                (2 * camera->MeanFocalLength());
  }
  const Rigid3d world_from_cam = image.cam_from_world.Inverse();
  std::array<Eigen::Vector3d, 4> corners;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector2d sign(i == 0 || i == 3 ? -1 : 1, i < 2 ? -1 : 1);
    corners[i] =
        world_from_cam *
        Eigen::Vector3d(depth * half_size.cwiseProduct(sign).homogeneous());
  }
  std::vector<Segment> edges;
  for (int i = 0; i < 4; ++i) {
    edges.push_back({world_from_cam.translation, corners[i]});
    edges.push_back({corners[i], corners[(i + 1) % 4]});
  }
  return edges;
}

// The nearest view in the given direction that holds all points (not empty).
//
// With t the tangent of half the field of view, |x - cx| <= t (z - cz) for all
// points says  cx - t cz >= a,  -cx - t cz >= b  with a = max(x - t z) and
// b = max(-x - t z); both are equalities at cx = (a - b) / 2 and
// cz = -(a + b) / (2 t). The same holds for y.
View FrameView(const Eigen::Matrix3d& view_from_world,
               const std::vector<Eigen::Vector3d>& points_in_view,
               double extent,
               int width,
               int height) {
  View view;
  view.view_from_world = view_from_world;
  view.focal_px = kFocalPerHeight * height;
  view.principal_point_px = 0.5 * Eigen::Vector2d(width, height);
  double nearest = std::numeric_limits<double>::infinity();
  view.center_in_view.z() = nearest;
  for (const Eigen::Vector3d& point : points_in_view) {
    nearest = std::min(nearest, point.z());
  }
  for (int axis = 0; axis < 2; ++axis) {
    const double t =
        (1 - 2 * kMargin) * view.principal_point_px(axis) / view.focal_px;
    double a = -std::numeric_limits<double>::infinity();
    double b = a;
    for (const Eigen::Vector3d& point : points_in_view) {
      a = std::max(a, point(axis) - t * point.z());
      b = std::max(b, -point(axis) - t * point.z());
    }
    view.center_in_view(axis) = 0.5 * (a - b);
    view.center_in_view.z() =
        std::min(view.center_in_view.z(), -(a + b) / (2 * t));
  }
  // Even a single point is seen from some distance.
  view.distance = std::max(nearest - view.center_in_view.z(), 0.3 * extent);
  view.center_in_view.z() = nearest - view.distance;
  return view;
}

Eigen::Vector3d Brighten(const Eigen::Vector3ub& color) {
  return 255 * (color.cast<double>() / 255).array().pow(kGamma);
}

void DrawPoints(const std::vector<ModelPoint>& points,
                const View& view,
                double extent,
                Canvas* canvas) {
  const double middle_depth = view.distance + 0.5 * extent;
  // Discs of a few points per hundred pixels cover surfaces without hiding
  // their structure.
  const double area_px = 4 * view.principal_point_px.prod();
  const double radius_px =
      std::clamp(0.2 * std::sqrt(area_px / (points.size() + 1)), 0.7, 2.5);
  const bool is_coloured =
      std::any_of(points.begin(), points.end(), [](const ModelPoint& point) {
        return !point.color.isZero();
      });
  for (const ModelPoint& point : points) {
    const Eigen::Vector3d xyz = view.ToView(point.xyz);
    if (xyz.z() < 0.5 * view.distance) continue;
    const Eigen::Vector3d color =
        is_coloured ? Brighten(point.color) : kColorOfUncoloured;
    // Far points fade into the background.
    const double visibility =
        std::clamp(1.6 - 0.6 * xyz.z() / middle_depth, 0.35, 1.0);
    canvas->DrawDisc(
        view.ToPixel(xyz),
        std::clamp(radius_px * middle_depth / xyz.z(), 0.5, 2 * radius_px),
        xyz.z(),
        visibility * color + (1 - visibility) * kBackground);
  }
}

void DrawSegment(const Segment& segment, const View& view, Canvas* canvas) {
  constexpr double kRadiusPx = 0.8;
  constexpr double kStepPx = 0.3;
  const Eigen::Vector3d start = view.ToView(segment[0]);
  const Eigen::Vector3d end = view.ToView(segment[1]);
  // A segment through the plane of the viewer has no bounded picture.
  if (std::min(start.z(), end.z()) <= 0) return;
  const double length_px = (view.ToPixel(end) - view.ToPixel(start)).norm();
  const int num_steps = 1 + static_cast<int>(length_px / kStepPx);
  for (int i = 0; i <= num_steps; ++i) {
    const Eigen::Vector3d xyz =
        start + (end - start) * (static_cast<double>(i) / num_steps);
    canvas->DrawDisc(view.ToPixel(xyz), kRadiusPx, xyz.z(), kFrustumColor);
  }
}

}  // namespace

colmap::Bitmap RenderModel(
    const std::map<std::string, ModelImage>& images,
    const std::map<colmap::camera_t, colmap::Camera>& cameras,
    const std::vector<ModelPoint>& points,
    int width,
    int height) {
  DGSFM_CHECK(!images.empty());
  DGSFM_CHECK(width > 0 && height > 0) << width << " x " << height;
  const Eigen::Matrix3d view_from_world = ChooseRotation(images);

  std::vector<Eigen::Vector3d> points_in_view;
  for (const ModelPoint& point : points) {
    points_in_view.push_back(view_from_world * point.xyz);
  }
  std::vector<Eigen::Vector3d> framed = WithoutTails(points_in_view);
  for (const auto& [name, image] : images) {
    framed.push_back(view_from_world *
                     image.cam_from_world.TargetOriginInSource());
  }
  const double extent = Extent(framed);

  std::vector<Segment> edges;
  for (const auto& [name, image] : images) {
    const auto camera = cameras.find(image.camera_id);
    for (const Segment& edge :
         FrustumEdges(image,
                      camera == cameras.end() ? nullptr : &camera->second,
                      0.06 * extent)) {
      edges.push_back(edge);
      framed.push_back(view_from_world * edge[1]);
    }
  }

  const View view = FrameView(view_from_world, framed, extent, width, height);
  Canvas canvas(width, height);
  DrawPoints(points, view, extent, &canvas);
  for (const Segment& edge : edges) DrawSegment(edge, view, &canvas);
  return canvas.ToBitmap();
}

int RunModelRenderer(int argc, char** argv) {
  constexpr int kMaxSize = 8192;
  std::string input_path, output_path;
  int width = 1280;
  int height = 720;
  CommandOptions options("model_renderer",
                         "Draw points and cameras of a model.");
  options.AddRequired(
      "input_path", &input_path, "Model folder, or folder of models.");
  options.AddRequired(
      "output_path", &output_path, "Picture to write, such as model.png.");
  options.Add("width", &width, "Width of the picture [px].");
  options.Add("height", &height, "Height of the picture [px].");
  if (const auto code = options.Parse(argc, argv)) return *code;
  if (std::min(width, height) < 16 || std::max(width, height) > kMaxSize) {
    std::cerr << "ERROR: --width and --height must be from 16 to " << kMaxSize
              << ", not " << width << " and " << height << std::endl;
    return 2;
  }

  const std::string folder = FindLargestModel(input_path);
  const std::map<std::string, ModelImage> images = ReadModelImages(folder);
  if (images.empty()) throw std::runtime_error(folder + " has no images");
  const colmap::Bitmap bitmap = RenderModel(
      images, ReadModelCameras(folder), ReadModelPoints(folder), width, height);
  WritePicture(output_path, bitmap);
  std::cout << "Picture: " << output_path << std::endl;
  return 0;
}

}  // namespace dgsfm
