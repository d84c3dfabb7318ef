#include "sfm/intrinsics/posterior_columns.h"

#include "colmap_ext/pose_access.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

namespace dgsfm {

namespace {

// At most so many images of a model: from the one with the most points, always
// the next that shares the most points with those chosen.
std::set<colmap::image_t> ChooseImages(const colmap::Reconstruction& model,
                                       size_t max_num_images) {
  std::map<colmap::image_t, size_t> num_shared;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    if (model.Image(image_id).NumPoints3D() > 0) num_shared[image_id] = 0;
  }
  std::set<colmap::image_t> chosen;
  if (num_shared.size() <= max_num_images) {
    for (const auto& [image_id, count] : num_shared) chosen.insert(image_id);
    return chosen;
  }
  const auto priority = [&](const auto& entry) {
    return std::make_pair(entry.second, model.Image(entry.first).NumPoints3D());
  };
  while (chosen.size() < max_num_images) {
    const auto best = std::max_element(num_shared.begin(),
                                       num_shared.end(),
                                       [&](const auto& a, const auto& b) {
                                         return priority(a) < priority(b);
                                       });
    const colmap::image_t image_id = best->first;
    num_shared.erase(best);
    chosen.insert(image_id);
    for (const colmap::Point2D& point2D : model.Image(image_id).Points2D()) {
      if (!point2D.HasPoint3D()) continue;
      for (const colmap::TrackElement& element :
           model.Point3D(point2D.Point3DId()).Track().Elements()) {
        const auto it = num_shared.find(element.image_id);
        if (it != num_shared.end()) ++it->second;
      }
    }
  }
  return chosen;
}

}  // namespace

PosteriorColumns::PosteriorColumns(const IntrinsicsPriorOptions& options,
                                   const CameraBeliefs& beliefs,
                                   const colmap::Reconstruction& model,
                                   IntrinsicsBlocks sharing,
                                   size_t max_num_images)
    : options_(options), beliefs_(beliefs), model_(model), sharing_(sharing) {
  for (const colmap::image_t image_id : ChooseImages(model, max_num_images)) {
    const colmap::Image& image = model.Image(image_id);
    image_ids.push_back(image_id);
    const auto [block, is_new] = blocks.try_emplace(BlockOf(image));
    if (is_new) AddIntrinsics(CameraIdOf(image), &block->second);
    ImageColumns& image_columns = columns.emplace_back();
    image_columns.fill(-1);
    for (int i = 0; i < kNumPoseParams; ++i) image_columns[i] = num_columns++;
    std::copy(block->second.columns.begin(),
              block->second.columns.end(),
              image_columns.begin() + kNumPoseParams);
  }
  FixGauge();
}

colmap::camera_t PosteriorColumns::CameraIdOf(
    const colmap::Image& image) const {
  if (sharing_ == IntrinsicsBlocks::BY_IMAGE) return image.CameraId();
  return beliefs_.FirstOfGroup(image.CameraId());
}

uint32_t PosteriorColumns::BlockOf(const colmap::Image& image) const {
  return sharing_ == IntrinsicsBlocks::BY_IMAGE ? image.ImageId()
                                                : CameraIdOf(image);
}

void PosteriorColumns::AddIntrinsics(colmap::camera_t camera_id, Block* block) {
  block->camera_id = camera_id;
  const Eigen::VectorXd stddevs = PriorStddevs(options_, beliefs_, camera_id);
  const Eigen::VectorXd deviations =
      Eigen::Map<const Eigen::VectorXd>(model_.Camera(camera_id).ParamsData(),
                                        stddevs.size()) -
      PriorMean(beliefs_, camera_id);
  for (const double stddev : stddevs) {
    block->columns.push_back(stddev == 0 ? -1 : num_columns++);
  }
  for (const RobustPrior& prior : SplitPriors(options_, beliefs_, camera_id)) {
    // A Cauchy loss weakens the prior of values far off.
    double squared_distance = 0;
    for (const Eigen::Index i : prior.idxs) {
      squared_distance += std::pow(deviations(i) / stddevs(i), 2);
    }
    const double loosening =
        std::sqrt(1 + squared_distance / (prior.loss_scale * prior.loss_scale));
    for (const Eigen::Index i : prior.idxs) {
      priors.push_back(
          {block->columns[size_t(i)], stddevs(i) * loosening, deviations(i)});
    }
  }
}

// Holds the first pose, and the distance of the farthest image from it by the
// coordinate that a change of scale moves most; all centres where they are one.
void PosteriorColumns::FixGauge() {
  const auto pose_of = [&](size_t image) {
    return CamFromWorld(model_.Image(image_ids[image]));
  };
  const Eigen::Vector3d center = pose_of(0).TargetOriginInSource();
  size_t farthest = 0;
  double max_distance = 0;
  for (size_t i = 0; i < image_ids.size(); ++i) {
    const double distance = (pose_of(i).TargetOriginInSource() - center).norm();
    if (distance <= max_distance) continue;
    max_distance = distance;
    farthest = i;
  }
  if (max_distance == 0) {
    // Images at one centre only turn.
    for (ImageColumns& image : columns) std::fill_n(image.begin() + 3, 3, -1);
  }
  int coordinate = 0;
  (pose_of(farthest) * center).cwiseAbs().maxCoeff(&coordinate);
  columns[farthest][3 + coordinate] = -1;
  std::fill_n(columns[0].begin(), kNumPoseParams, -1);
}

}  // namespace dgsfm
