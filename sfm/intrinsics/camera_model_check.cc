#include "sfm/intrinsics/camera_model_check.h"

#include "colmap_ext/pose_access.h"
#include "estimators/median.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <vector>

namespace dgsfm {

namespace {

constexpr int kNumRings = 8;
constexpr int kMinNumObservations = 100;
// Mean radial errors of photos whose camera model fits are 0.2 px at most.
constexpr double kMaxMeanErrorPx = 0.5;
// The bound for wide-angle lenses: perspective models leave mean errors of 0.25
// to 0.7 px on fisheye images.
constexpr double kMaxWideMeanErrorPx = 0.22;
// Principal points of wide-angle lenses are that far off only if they make up
// for another projection, or if the images are crops.
constexpr double kMaxCenterOffsetRatio = 0.05;
// Horizontal field of view of 80 degrees.
constexpr double kWideFocalRatio = 0.6;

}  // namespace

RadialErrors MeasureRadialErrors(const colmap::Reconstruction& model) {
  struct Ring {
    double sum_px = 0;
    int count = 0;
  };
  std::array<Ring, kNumRings> rings;
  std::vector<double> focal_ratios, offset_ratios;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    const colmap::Image& image = model.Image(image_id);
    const colmap::Camera& camera = model.Camera(image.CameraId());
    focal_ratios.push_back(camera.MeanFocalLength() / LargerSide(camera));
    const Eigen::Vector2d center(camera.Width() / 2.0, camera.Height() / 2.0);
    const Eigen::Vector2d principal_point(camera.PrincipalPointX(),
                                          camera.PrincipalPointY());
    offset_ratios.push_back((principal_point - center).norm() /
                            LargerSide(camera));
    for (const colmap::Point2D& point2D : image.Points2D()) {
      if (!point2D.HasPoint3D()) continue;
      const Eigen::Vector3d in_cam =
          CamFromWorld(image) * model.Point3D(point2D.Point3DId()).XYZ();
      const Eigen::Vector2d offset = point2D.XY() - center;
      const double radius = offset.norm();
      if (!(in_cam.z() > 0) || radius < 1) continue;
      const int index =
          std::min(int(kNumRings * radius / center.norm()), kNumRings - 1);
      const Eigen::Vector2d error =
          camera.WorldToImage(in_cam.hnormalized()) - point2D.XY();
      rings[size_t(index)].sum_px += error.dot(offset) / radius;
      ++rings[size_t(index)].count;
    }
  }
  RadialErrors errors;
  if (!focal_ratios.empty()) {
    errors.focal_ratio = Median(focal_ratios);
    errors.center_offset_ratio = Median(offset_ratios);
  }
  for (const Ring& ring : rings) {
    if (ring.count < kMinNumObservations) continue;
    errors.max_mean_px = std::max(errors.max_mean_px,
                                  std::abs(ring.sum_px / double(ring.count)));
  }
  return errors;
}

std::optional<std::string> CameraModelAdvice(const RadialErrors& errors) {
  const bool is_wide = errors.focal_ratio < kWideFocalRatio;
  const bool has_radial_errors =
      errors.max_mean_px > (is_wide ? kMaxWideMeanErrorPx : kMaxMeanErrorPx);
  const bool is_off_center =
      is_wide && errors.center_offset_ratio > kMaxCenterOffsetRatio;
  if (!has_radial_errors && !is_off_center) return std::nullopt;
  std::ostringstream text;
  text.precision(2);
  text << "The camera model seems not to fit: focal lengths are "
       << errors.focal_ratio
       << " times the image width, errors along the radius of the images up to "
       << errors.max_mean_px << " px in the mean, principal points "
       << 100 * errors.center_offset_ratio
       << " % off the centre. Extract the features with another one ("
       << (is_wide ? "--ImageReader.camera_model OPENCV_FISHEYE with known "
                     "intrinsics for a fisheye lens, else OPENCV"
                   : "--ImageReader.camera_model RADIAL or OPENCV")
       << ")";
  return text.str();
}

}  // namespace dgsfm
