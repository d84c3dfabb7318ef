#include "sfm/intrinsics/prior_trust.h"

#include <colmap/base/camera_models.h>

#include <algorithm>
#include <cmath>

namespace dgsfm {

namespace {

// Standard deviation of the logarithm of focal lengths by EXIF data [1].
constexpr double kExifLogStddev = 0.05;

bool IsFisheye(const colmap::Camera& camera) {
  const int id = camera.ModelId();
  return id == colmap::FOVCameraModel::model_id ||
         id == colmap::SimpleRadialFisheyeCameraModel::model_id ||
         id == colmap::RadialFisheyeCameraModel::model_id ||
         id == colmap::OpenCVFisheyeCameraModel::model_id ||
         id == colmap::ThinPrismFisheyeCameraModel::model_id;
}

}  // namespace

std::optional<PriorTrust> PriorTrustFromName(const std::string& name) {
  if (name == "auto") return PriorTrust::AUTO;
  if (name == "exif") return PriorTrust::EXIF;
  if (name == "calibrated") return PriorTrust::CALIBRATED;
  return std::nullopt;
}

bool LooksLikeExif(const colmap::Camera& camera) {
  if (!camera.HasPriorFocalLength() || IsFisheye(camera)) return false;
  const auto all_are = [&](const std::vector<size_t>& idxs, double value) {
    return std::all_of(idxs.begin(), idxs.end(), [&](size_t idx) {
      return camera.Params(idx) == value;
    });
  };
  const std::vector<size_t>& focals = camera.FocalLengthIdxs();
  return all_are(focals, camera.Params(focals.front())) &&
         camera.PrincipalPointX() == double(camera.Width()) / 2 &&
         camera.PrincipalPointY() == double(camera.Height()) / 2 &&
         all_are(camera.ExtraParamsIdxs(), 0);
}

void SortPriors(PriorTrust trust, Scene* scene) {
  for (auto& [camera_id, camera] : scene->cameras) {
    if (!camera.HasPriorFocalLength() || trust == PriorTrust::CALIBRATED ||
        (trust == PriorTrust::AUTO && !LooksLikeExif(camera))) {
      continue;
    }
    camera.SetPriorFocalLength(false);
    scene->focal_priors[camera_id] = {camera.MeanFocalLength(), kExifLogStddev};
  }
}

FocalPrior FocalPriorOf(const Scene& scene, colmap::camera_t camera_id) {
  const auto prior = scene.focal_priors.find(camera_id);
  if (prior != scene.focal_priors.end()) return prior->second;
  const auto exif = scene.exif.find(camera_id);
  if (exif == scene.exif.end() || exif->second.focal_length_ratio == 0) {
    return {};
  }
  const colmap::Camera& camera = scene.cameras.at(camera_id);
  return {exif->second.focal_length_ratio *
              std::hypot(double(camera.Width()), double(camera.Height())),
          kExifLogStddev};
}

}  // namespace dgsfm
