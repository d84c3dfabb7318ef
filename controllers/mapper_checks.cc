#include "controllers/mapper_checks.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/depth/image_orientation.h"
#include "colmap_ext/output_file.h"

#include <filesystem>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include <glog/logging.h>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

// Positions whose latitude and longitude are swapped show by the shape of the
// largest model.
void CheckForSwappedCoordinates(const GeoreferencingOptions& options,
                                const LoadedPosePriors& loaded,
                                DepthGlobalMapperResult* result) {
  if (result->models.empty() || loaded.swapped_priors.empty()) return;
  const colmap::Reconstruction& model = *result->models.front();
  const auto given =
      AlignToPositions(options, loaded.priors, std::nullopt, model);
  const auto swapped =
      AlignToPositions(options, loaded.swapped_priors, std::nullopt, model);
  constexpr double kMinRatio = 3;  // of the errors
  if (!given || !swapped || given->spread < kMinRatio * swapped->spread ||
      given->spread < kMinRatio) {
    return;
  }
  result->warnings.push_back(
      "Latitude and longitude of the positions seem to be swapped: swapped "
      "back, they fit the largest model better");
  LOG(WARNING) << result->warnings.back();
}

}  // namespace

void CheckImagesExist(const std::string& image_path, const Scene& scene) {
  size_t num_missing = 0;
  std::string first_missing;
  for (const auto& [image_id, image] : scene.images) {
    if (fs::exists(PathInside(image_path, image.Name()))) continue;
    if (num_missing++ == 0) first_missing = image.Name();
  }
  if (num_missing > 0) {
    throw std::runtime_error(
        image_path + " lacks " + std::to_string(num_missing) + " of " +
        std::to_string(scene.images.size()) + " images, e.g. " + first_missing +
        "; leave --image_path out to map without colours");
  }
}

void ReadExif(const std::string& image_path, Scene* scene) {
  for (const auto& [image_id, image] : scene->images) {
    const colmap::camera_t camera_id = image.CameraId();
    if (scene->cameras.at(camera_id).HasPriorFocalLength() ||
        scene->exif.count(camera_id) > 0) {
      continue;
    }
    const std::string path = PathInside(image_path, image.Name());
    try {
      scene->exif[camera_id] = ReadImageExif(path);
    } catch (const std::runtime_error& error) {
      LOG(WARNING) << "No EXIF data: " << error.what();
    }
  }
}

void WarnOfPositions(const GeoreferencingOptions& options,
                     const LoadedPosePriors& loaded,
                     DepthGlobalMapperResult* result) {
  for (const std::string& warning : loaded.warnings) {
    LOG(WARNING) << "Positions of images: " << warning;
    result->warnings.push_back("Positions of images: " + warning);
  }
  CheckForSwappedCoordinates(options, loaded, result);
}

void WarnOfTurnedImages(const GlobalDepthMapperOptions& options,
                        const Scene& scene,
                        const KeypointDepthMap& depths) {
  const std::string& image_path = options.image_path;
  const std::set<colmap::image_t> turned_back =
      DepthDatabase(options.verifier.database_path,
                    DepthDatabase::Mode::READ_ONLY)
          .ReadDisplayedImages();
  std::vector<std::string> names;
  // Maps of images turned by a quarter have another shape, and were refused.
  for (const auto& [image_id, image_depths] : depths) {
    if (turned_back.count(image_id) > 0) continue;
    const colmap::Image& image = scene.images.at(image_id);
    const colmap::Camera& camera = scene.cameras.at(image.CameraId());
    try {
      const int orientation =
          ReadExifOrientation(PathInside(image_path, image.Name()));
      const bool has_other_shape =
          orientation >= 5 && camera.Width() != camera.Height();
      if (orientation != 1 && !has_other_shape) names.push_back(image.Name());
    } catch (const std::runtime_error& error) {
      LOG(WARNING) << "No EXIF data: " << error.what();
    }
  }
  if (names.empty()) return;
  LOG(WARNING) << names.size() << " images with depth, e.g. " << names.front()
               << ", are turned by EXIF in a way that the shape of a map does "
                  "not show: if their maps were made of the images as viewers "
                  "show them, they must have been imported with "
                  "depth_importer --displayed_image_path";
}

}  // namespace dgsfm
