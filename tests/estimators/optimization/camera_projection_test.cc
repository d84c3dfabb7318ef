#include "estimators/optimization/camera_projection.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera_models.h>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct Model {
  int id;
  std::vector<double> params;
};

std::vector<Model> Models() {
  return {{0, {500, 320, 240}},
          {1, {500, 510, 320, 240}},
          {2, {500, 320, 240, 0.1}},
          {3, {500, 320, 240, 0.1, -0.05}},
          {4, {500, 510, 320, 240, 0.1, -0.05, 0.01, -0.02}},
          {5, {500, 510, 320, 240, 0.1, -0.05, 0.01, -0.02}},
          {6, {500, 510, 320, 240, .1, -.05, .01, -.02, .01, .02, .03, .01}},
          {7, {500, 510, 320, 240, 0.3}},
          {8, {500, 320, 240, 0.1}},
          {9, {500, 320, 240, 0.1, -0.05}},
          {10, {500, 510, 320, 240, .1, -.05, .01, -.02, .01, .02, .03, .01}}};
}

const std::vector<Eigen::Vector3d> kPoints = {
    {0.3, -0.2, 1.5}, {-2.0, 1.0, 4.0}, {0.1, 0.2, -1.0}};

TEST(CameraProjection, AgreesWithColmap) {
  for (const Model& model : Models()) {
    for (const Eigen::Vector3d& point : kPoints) {
      Eigen::Vector2d expected;
      colmap::CameraModelWorldToImage(model.id,
                                      model.params,
                                      point.x() / point.z(),
                                      point.y() / point.z(),
                                      &expected.x(),
                                      &expected.y());
      Eigen::Vector2d xy_px;
      ProjectionJacobian jacobian;
      const ProjectionFunction project = ProjectionOfModel(model.id);
      ASSERT_TRUE(project(model.params.data(), point, &xy_px, nullptr));
      // Rounding of numbers in the hundreds.
      EXPECT_LT((xy_px - expected).norm(), 1e-10) << "model " << model.id;
      ASSERT_TRUE(project(model.params.data(), point, &xy_px, &jacobian));
      EXPECT_LT((xy_px - expected).norm(), 1e-10) << "model " << model.id;
    }
  }
}

TEST(CameraProjection, AnalyticDerivativesAgreeWithAutomaticOnes) {
  for (const Model& model : Models()) {
    for (const Eigen::Vector3d& point : kPoints) {
      Eigen::Vector2d xy_px;
      ProjectionJacobian analytic;
      ProjectionJacobian automatic;
      ASSERT_TRUE(ProjectionOfModel(model.id)(
          model.params.data(), point, &xy_px, &analytic));
      ASSERT_TRUE(AutoDiffProjectionOfModel(model.id)(
          model.params.data(), point, &xy_px, &automatic));
      const auto num_params = Eigen::Index(model.params.size());
      // Rounding of derivatives in the thousands.
      EXPECT_LT((analytic.point - automatic.point).norm(), 1e-9)
          << "model " << model.id;
      EXPECT_LT((analytic.params.leftCols(num_params) -
                 automatic.params.leftCols(num_params))
                    .norm(),
                1e-9)
          << "model " << model.id;
    }
  }
}

TEST(CameraProjection, PlaneOfTheCenterHasNoImage) {
  for (const Model& model : Models()) {
    Eigen::Vector2d xy_px;
    EXPECT_FALSE(ProjectionOfModel(model.id)(
        model.params.data(), {1, 2, 0}, &xy_px, nullptr));
  }
}

TEST(CameraProjection, UnknownModelThrows) {
  EXPECT_THROW(ProjectionOfModel(99), std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
