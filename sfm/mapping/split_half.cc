#include "sfm/mapping/split_half.h"

#include "colmap_ext/pose_access.h"
#include "estimators/random.h"
#include "sfm/mapping/model_access.h"

#include <map>
#include <string>

namespace dgsfm {

namespace {

using NamedPoses = std::map<std::string, Rigid3d>;

std::optional<NamedPoses> PosesOfHalf(const ModelAdjuster& adjust,
                                      int max_num_iterations,
                                      const CameraBeliefs& beliefs,
                                      uint64_t half,
                                      colmap::Reconstruction model) {
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    if (SplitMix64(point_id)() % 2 != half) model.DeletePoint3D(point_id);
  }
  if (!adjust(beliefs, max_num_iterations, &model)) return std::nullopt;
  NamedPoses poses;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    const colmap::Image& image = model.Image(image_id);
    poses.emplace(image.Name(), CamFromWorld(image));
  }
  return poses;
}

}  // namespace

std::optional<PoseMetrics> SplitHalfRepeatability(
    const ModelAdjuster& adjust,
    int max_num_iterations,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  const auto first = PosesOfHalf(adjust, max_num_iterations, beliefs, 0, model);
  const auto second =
      PosesOfHalf(adjust, max_num_iterations, beliefs, 1, model);
  if (!first || !second) return std::nullopt;
  return EvaluatePoses(*first, *second);
}

}  // namespace dgsfm
