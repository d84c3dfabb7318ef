#include "sfm/mapping/bundle_adjustment.h"

#include "colmap_ext/pose_access.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "estimators/pose_metrics.h"

#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <string>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr double kScalePx = 0.2;
// As of the mapper's filter.
constexpr double kMaxErrorPx = 4;

using Rng = std::mt19937;

// Draws from Student's t distribution in the plane, or from the Gaussian one
// where there are no degrees of freedom.
Eigen::Vector2d DrawError(std::optional<double> degrees_of_freedom, Rng* rng) {
  std::normal_distribution<double> normal(0, kScalePx);
  Eigen::Vector2d error;
  do {
    error << normal(*rng), normal(*rng);
    if (!degrees_of_freedom) continue;
    std::chi_squared_distribution<double> squares(*degrees_of_freedom);
    error /= std::sqrt(squares(*rng) / *degrees_of_freedom);
  } while (!(error.norm() < kMaxErrorPx));
  return error;
}

class DisturbedScene {
 public:
  // Tracks have so many observations at most.
  DisturbedScene(uint32_t seed,
                 std::optional<double> degrees_of_freedom,
                 size_t max_track_length = 100) {
    SyntheticSceneOptions options = SceneFamilyOptions(SceneFamily::RING);
    options.num_images = 20;
    options.num_points_per_image = 200;
    options.random_seed = seed;
    const SyntheticScene synthetic = SynthesizeScene(options);
    beliefs_.given = SceneFromSynthetic(synthetic).cameras;
    truth_ = ReconstructionFromSynthetic(synthetic);
    ShortenTracks(max_track_length);
    Rng rng(seed);
    model_ = truth_;
    for (const colmap::image_t image_id : truth_.RegImageIds()) {
      colmap::Image& image = model_.Image(image_id);
      for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
        colmap::Point2D& point2D = image.Point2D(i);
        point2D.SetXY(point2D.XY() + DrawError(degrees_of_freedom, &rng));
      }
    }
  }

  // As the mapper does: once with the options' loss, then with what fits.
  LossScales Adjust(bool use_cauchy) {
    EXPECT_TRUE(AdjustBundle(options_, 1, 1, beliefs_, &model_));
    const LossScales scales = AdaptedLossScales(options_, model_);
    options_.loss_scale_px = scales.soft_l1_px;
    if (use_cauchy) options_.cauchy_scale_px = scales.cauchy_px;
    EXPECT_TRUE(AdjustBundle(options_, 1, 1, beliefs_, &model_));
    return scales;
  }

  double MeanErrorDeg() const {
    const PoseMetrics metrics = EvaluatePoses(Poses(truth_), Poses(model_));
    double sum = 0;
    for (const double error_deg : metrics.relative_errors_deg) sum += error_deg;
    return sum / double(metrics.relative_errors_deg.size());
  }

 private:
  static std::map<std::string, Rigid3d> Poses(
      const colmap::Reconstruction& model) {
    std::map<std::string, Rigid3d> poses;
    for (const colmap::image_t image_id : model.RegImageIds()) {
      const colmap::Image& image = model.Image(image_id);
      poses[image.Name()] = CamFromWorld(image);
    }
    return poses;
  }

  void ShortenTracks(size_t max_length) {
    for (const colmap::point3D_t point_id : truth_.Point3DIds()) {
      while (truth_.Point3D(point_id).Track().Length() > max_length) {
        const colmap::TrackElement last =
            truth_.Point3D(point_id).Track().Elements().back();
        truth_.DeleteObservation(last.image_id, last.point2D_idx);
      }
    }
  }

  BundleAdjustmentOptions options_;
  CameraBeliefs beliefs_;
  colmap::Reconstruction truth_;
  colmap::Reconstruction model_;
};

TEST(AdaptedLossScales, CauchyLossForHeavyTailsAlone) {
  DisturbedScene gaussian(0, std::nullopt);
  EXPECT_FALSE(gaussian.Adjust(true).cauchy_px);
  DisturbedScene heavy(0, 1.0);
  const LossScales scales = heavy.Adjust(true);
  ASSERT_TRUE(scales.cauchy_px);
  // 1.5 times the median and the median, of errors that the fit has reduced.
  EXPECT_NEAR(scales.soft_l1_px / *scales.cauchy_px, 1.5, 0.1);
}

TEST(AdaptedLossScales, PointsOfTwoImagesShowNoTails) {
  DisturbedScene heavy(0, 1.0, 2);
  EXPECT_FALSE(heavy.Adjust(true).cauchy_px);
}

TEST(AdaptedLossScales, ThatOfTheOptionsWithoutPoints) {
  const LossScales scales = AdaptedLossScales({}, colmap::Reconstruction());
  EXPECT_EQ(scales.soft_l1_px, BundleAdjustmentOptions().loss_scale_px);
  EXPECT_FALSE(scales.cauchy_px);
}

TEST(AdjustBundle, CauchyLossGainsWhereTailsAreHeavy) {
  double soft_sum = 0;
  double cauchy_sum = 0;
  for (uint32_t seed = 0; seed < 8; ++seed) {
    DisturbedScene soft(seed, 1.0);
    soft.Adjust(false);
    soft_sum += soft.MeanErrorDeg();
    DisturbedScene cauchy(seed, 1.0);
    cauchy.Adjust(true);
    cauchy_sum += cauchy.MeanErrorDeg();
  }
  // 0.66 and 0.76 degrees.
  EXPECT_LT(cauchy_sum, 0.95 * soft_sum);
}

}  // namespace
}  // namespace dgsfm
