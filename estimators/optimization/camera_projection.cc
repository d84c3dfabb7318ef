#include "estimators/optimization/camera_projection.h"

#include "colmap_ext/check.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera_models.h>

#include <limits>

#include <ceres/jet.h>

namespace dgsfm {

namespace {

bool IsInPlaneOfCenter(const Eigen::Vector3d& point_in_cam) {
  // Negated to catch NaN.
  return !(std::abs(point_in_cam.z()) > std::numeric_limits<double>::epsilon());
}

// Where a model keeps its parameters; -1 = it has none of these.
struct ParamLayout {
  int focal_x, focal_y, center_x, center_y, k1, k2, p1, p2;
};
constexpr ParamLayout kSimplePinhole = {0, 0, 1, 2, -1, -1, -1, -1};
constexpr ParamLayout kPinhole = {0, 1, 2, 3, -1, -1, -1, -1};
constexpr ParamLayout kSimpleRadial = {0, 0, 1, 2, 3, -1, -1, -1};
constexpr ParamLayout kRadial = {0, 0, 1, 2, 3, 4, -1, -1};
constexpr ParamLayout kOpenCV = {0, 1, 2, 3, 4, 5, 6, 7};

constexpr double ParamAt(const double* params, int index) {
  return index < 0 ? 0 : params[index];
}

// The perspective models are OPENCV with some parameters equal or zero:
//   x = f_x u' + c_x,  u' = u (1 + k1 r^2 + k2 r^4) + 2 p1 u v
//                           + p2 (r^2 + 2 u^2),  u = X / Z, r^2 = u^2 + v^2
// and y by exchanging u and v, p1 and p2.
template <const ParamLayout& kLayout>
bool ProjectPerspective(const double* params,
                        const Eigen::Vector3d& point_in_cam,
                        Eigen::Vector2d* xy_px,
                        ProjectionJacobian* jacobian) {
  if (IsInPlaneOfCenter(point_in_cam)) return false;
  const double fx = params[kLayout.focal_x];
  const double fy = params[kLayout.focal_y];
  const double k1 = ParamAt(params, kLayout.k1);
  const double k2 = ParamAt(params, kLayout.k2);
  const double p1 = ParamAt(params, kLayout.p1);
  const double p2 = ParamAt(params, kLayout.p2);
  const double inverse_z = 1 / point_in_cam.z();
  const double u = point_in_cam.x() * inverse_z;
  const double v = point_in_cam.y() * inverse_z;
  const double uu = u * u;
  const double vv = v * v;
  const double uv = u * v;
  const double rr = uu + vv;
  const double radial = 1 + rr * (k1 + rr * k2);
  const double u_distorted = u * radial + 2 * p1 * uv + p2 * (rr + 2 * uu);
  const double v_distorted = v * radial + 2 * p2 * uv + p1 * (rr + 2 * vv);
  *xy_px << fx * u_distorted + params[kLayout.center_x],
      fy * v_distorted + params[kLayout.center_y];
  if (jacobian == nullptr) return true;

  // By u and v.
  const double radial_slope = 2 * (k1 + 2 * rr * k2);
  const double cross = radial_slope * uv + 2 * (p1 * u + p2 * v);
  const double xu = fx * (radial + radial_slope * uu + 2 * p1 * v + 6 * p2 * u);
  const double xv = fx * cross;
  const double yu = fy * cross;
  const double yv = fy * (radial + radial_slope * vv + 2 * p2 * u + 6 * p1 * v);
  jacobian->point << xu * inverse_z, xv * inverse_z,
      -(xu * u + xv * v) * inverse_z, yu * inverse_z, yv * inverse_z,
      -(yu * u + yv * v) * inverse_z;

  auto& J = jacobian->params;
  if constexpr (kLayout.focal_x == kLayout.focal_y) {
    J.col(kLayout.focal_x) << u_distorted, v_distorted;
  } else {
    J.col(kLayout.focal_x) << u_distorted, 0;
    J.col(kLayout.focal_y) << 0, v_distorted;
  }
  J.col(kLayout.center_x) << 1, 0;
  J.col(kLayout.center_y) << 0, 1;
  if constexpr (kLayout.k1 >= 0) J.col(kLayout.k1) << fx * u * rr, fy * v * rr;
  if constexpr (kLayout.k2 >= 0) {
    J.col(kLayout.k2) << fx * u * rr * rr, fy * v * rr * rr;
  }
  if constexpr (kLayout.p1 >= 0) {
    J.col(kLayout.p1) << fx * 2 * uv, fy * (rr + 2 * vv);
    J.col(kLayout.p2) << fx * (rr + 2 * uu), fy * 2 * uv;
  }
  return true;
}

template <typename CameraModel>
bool ProjectWithAutoDiff(const double* params,
                         const Eigen::Vector3d& point_in_cam,
                         Eigen::Vector2d* xy_px,
                         ProjectionJacobian* jacobian) {
  if (IsInPlaneOfCenter(point_in_cam)) return false;
  if (jacobian == nullptr) {
    const Eigen::Vector2d uv = point_in_cam.hnormalized();
    CameraModel::WorldToImage(params, uv.x(), uv.y(), &xy_px->x(), &xy_px->y());
    return xy_px->allFinite();
  }
  constexpr int kNumParams = CameraModel::kNumParams;
  using Jet = ceres::Jet<double, 3 + kNumParams>;
  Jet jet_params[kNumParams];
  for (int i = 0; i < kNumParams; ++i) jet_params[i] = Jet(params[i], 3 + i);
  const Jet z(point_in_cam.z(), 2);
  const Jet u = Jet(point_in_cam.x(), 0) / z;
  const Jet v = Jet(point_in_cam.y(), 1) / z;
  Jet x, y;
  CameraModel::WorldToImage(jet_params, u, v, &x, &y);
  *xy_px << x.a, y.a;
  jacobian->point << x.v.template head<3>().transpose(),
      y.v.template head<3>().transpose();
  jacobian->params.template leftCols<kNumParams>()
      << x.v.template tail<kNumParams>().transpose(),
      y.v.template tail<kNumParams>().transpose();
  return xy_px->allFinite();
}

}  // namespace

ProjectionFunction ProjectionOfModel(int camera_model_id) {
  switch (camera_model_id) {
    case colmap::SimplePinholeCameraModel::kModelId:
      return ProjectPerspective<kSimplePinhole>;
    case colmap::PinholeCameraModel::kModelId:
      return ProjectPerspective<kPinhole>;
    case colmap::SimpleRadialCameraModel::kModelId:
      return ProjectPerspective<kSimpleRadial>;
    case colmap::RadialCameraModel::kModelId:
      return ProjectPerspective<kRadial>;
    case colmap::OpenCVCameraModel::kModelId:
      return ProjectPerspective<kOpenCV>;
    default:
      return AutoDiffProjectionOfModel(camera_model_id);
  }
}

ProjectionFunction AutoDiffProjectionOfModel(int camera_model_id) {
  switch (camera_model_id) {
#define CAMERA_MODEL_CASE(CameraModel)               \
  case colmap::CameraModel::kModelId: {              \
    return ProjectWithAutoDiff<colmap::CameraModel>; \
  }
    CAMERA_MODEL_CASES
#undef CAMERA_MODEL_CASE
  }
  DGSFM_CHECK(false) << "unknown camera model " << camera_model_id;
  return nullptr;
}

}  // namespace dgsfm
