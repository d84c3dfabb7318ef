#include "sfm/mapping/depth_kind_check.h"

#include "colmap_ext/pose_access.h"
#include "sfm/mapping/model_access.h"
#include "sfm/verification/depth_kind.h"

#include <map>

namespace dgsfm {

namespace {

// Images of a model that show what its maps are.
constexpr size_t kMaxNumJudgedImages = 50;

std::vector<MeasuredDepth> DepthsOfModel(const colmap::Reconstruction& model,
                                         const colmap::Image& image) {
  const Rigid3d cam_from_world = CamFromWorld(image);
  std::vector<MeasuredDepth> measured;
  for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
    if (!image.Point2D(i).HasPoint3D()) continue;
    const double depth =
        (cam_from_world * model.Point3D(image.Point2D(i).Point3DId()).XYZ())
            .z();
    if (depth > 0) measured.push_back({i, depth});
  }
  return measured;
}

}  // namespace

std::vector<std::string> WarningsOfDepthKinds(const Scene& scene,
                                              const KeypointDepthMap& depths,
                                              const Models& models) {
  std::map<DepthUnit, std::vector<std::vector<double>>> concordances;
  for (const auto& model : models) {
    const std::vector<colmap::image_t> image_ids =
        SortedRegisteredImages(*model);
    const size_t step = image_ids.size() / kMaxNumJudgedImages + 1;
    for (size_t i = 0; i < image_ids.size(); i += step) {
      const colmap::image_t image_id = image_ids[i];
      const auto found = depths.find(image_id);
      if (found == depths.end()) continue;
      const colmap::Image& image = scene.images.at(image_id);
      concordances[found->second.unit].push_back(ConcordancesByArrangement(
          image,
          scene.cameras.at(image.CameraId()),
          found->second,
          {DepthsOfModel(*model, model->Image(image_id))}));
    }
  }
  std::vector<std::string> warnings;
  for (const auto& [unit, of_images] : concordances) {
    const std::string explanation = ExplainWrongKind(unit, of_images);
    if (explanation.empty()) continue;
    warnings.push_back(
        "The depth maps, of which those of " +
        std::to_string(of_images.size()) +
        " images were looked at, are not what they were imported as: " +
        explanation);
  }
  return warnings;
}

RelativeDepthFits FitRelativeDepthsToModels(const KeypointDepthMap& depths,
                                            const Models& models) {
  RelativeDepthFits fits;
  for (const auto& model : models) {
    for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
      const auto found = depths.find(image_id);
      if (found == depths.end() || !IsAffine(found->second.unit)) continue;
      fits[image_id] = FitRelativeDepth(
          found->second, DepthsOfModel(*model, model->Image(image_id)));
    }
  }
  return fits;
}

}  // namespace dgsfm
