#include "controllers/multi_view_refinement.h"

#include "colmap_ext/parallel.h"
#include "controllers/progress.h"
#include "estimators/median.h"

#include <algorithm>
#include <iterator>
#include <optional>
#include <set>
#include <utility>

namespace dgsfm {
namespace {

// Errors of maps are not taken for smaller ones.
constexpr double kMinResidual = 1e-3;
constexpr int kNumFieldCorrections = 3;

std::vector<std::vector<size_t>> FindNeighborsInModel(
    const SparseModel& model,
    const std::vector<ViewToRefine>& views,
    const ViewNeighborOptions& options) {
  std::vector<Eigen::Vector3d> centers;
  std::map<colmap::point3D_t, SharedPoint> points;
  for (size_t i = 0; i < views.size(); ++i) {
    const ModelImage& image = model.images.at(views[i].image_name);
    centers.push_back(image.cam_from_world.TargetOriginInSource());
    for (const ModelObservation& observation : image.observations) {
      const auto point = model.points.find(observation.point3D_id);
      if (point == model.points.end()) continue;
      SharedPoint& shared = points[point->first];
      shared.xyz = point->second;
      // A point may have two observations in an image.
      if (shared.images.empty() || shared.images.back() != i) {
        shared.images.push_back(i);
      }
    }
  }
  std::vector<SharedPoint> list;
  list.reserve(points.size());
  for (auto& [id, point] : points) list.push_back(std::move(point));
  return FindNeighbors(centers, list, options);
}

}  // namespace

bool MultiViewRefinementOptions::IsValid(std::string* error) const {
  return neighbors.IsValid(error) && depth.IsValid(error) &&
         alignment.IsValid(error);
}

MultiViewRefinement::MultiViewRefinement(
    const SparseModel& model,
    const MultiViewRefinementOptions& options,
    std::vector<ViewToRefine>* views,
    Load load)
    : model_(model),
      options_(options),
      views_(*views),
      load_(std::move(load)),
      neighbors_(FindNeighborsInModel(model, *views, options.neighbors)) {}

void MultiViewRefinement::Run(const Write& write) {
  if (options_.alignment.model == DepthAlignmentModel::FIELD) {
    for (int i = 0; i < kNumFieldCorrections; ++i) CorrectFields();
  }
  Progress progress("Refining depth maps", views_.size());
  for (size_t begin = 0; begin < views_.size(); begin = BatchEnd(begin)) {
    // Pixels of one image are refined by all threads, then images are written
    // by one thread each.
    std::vector<RefinedDepth> refined;
    for (size_t i = begin; i < BatchEnd(begin); ++i) {
      Hold(i);
      refined.push_back(RefineDepth(
          *loaded_.at(i), Neighbors(i), options_.depth, options_.num_threads));
      progress.Step();
    }
    ParallelFor(refined.size(), options_.num_threads, [&](size_t k) {
      write(begin + k, std::move(refined[k]));
    });
  }
}

size_t MultiViewRefinement::BatchEnd(size_t begin) const {
  return std::min(views_.size(),
                  begin + EffectiveNumThreads(options_.num_threads));
}

// Loads a view and its neighbours, and forgets the others.
void MultiViewRefinement::Hold(size_t i) {
  std::set<size_t> needed(neighbors_[i].begin(), neighbors_[i].end());
  needed.insert(i);
  for (auto view = loaded_.begin(); view != loaded_.end();) {
    view = needed.count(view->first) ? std::next(view) : loaded_.erase(view);
  }
  std::vector<size_t> missing;
  for (const size_t view : needed) {
    if (loaded_.emplace(view, nullptr).second) missing.push_back(view);
  }
  ParallelFor(missing.size(), options_.num_threads, [&](size_t k) {
    const ViewToRefine& view = views_[missing[k]];
    DepthMap map = load_(missing[k]);
    view.alignment.Apply(&map);
    loaded_.at(missing[k]) = std::make_unique<DepthView>(
        CameraOfImage(model_, view.image_name),
        model_.images.at(view.image_name).cam_from_world,
        std::move(map),
        kStddevPerMad * std::max(kMinResidual, view.alignment.residual));
  });
}

std::vector<const DepthView*> MultiViewRefinement::Neighbors(size_t i) const {
  std::vector<const DepthView*> neighbors;
  for (const size_t neighbor : neighbors_[i]) {
    neighbors.push_back(loaded_.at(neighbor).get());
  }
  return neighbors;
}

// The points of the model, and pixels whose depth the neighbours share.
std::vector<DepthCorrespondence> MultiViewRefinement::FindCorrespondences(
    size_t i) const {
  const DepthView& view = *loaded_.at(i);
  std::vector<DepthCorrespondence> correspondences =
      FindDepthCorrespondences(model_, views_[i].image_name, view.Map());
  const std::vector<DepthCorrespondence> agreements =
      FindAgreements(view, Neighbors(i), options_.depth);
  correspondences.insert(
      correspondences.end(), agreements.begin(), agreements.end());
  return correspondences;
}

// All by the maps as they were before, so that their order has no influence.
void MultiViewRefinement::CorrectFields() {
  std::vector<std::optional<DepthAlignment>> corrections(views_.size());
  Progress progress("Correcting depth fields", views_.size());
  for (size_t begin = 0; begin < views_.size(); begin = BatchEnd(begin)) {
    std::vector<std::vector<DepthCorrespondence>> correspondences;
    for (size_t i = begin; i < BatchEnd(begin); ++i) {
      Hold(i);
      correspondences.push_back(FindCorrespondences(i));
    }
    ParallelFor(correspondences.size(), options_.num_threads, [&](size_t k) {
      const colmap::Camera& camera =
          CameraOfImage(model_, views_[begin + k].image_name);
      corrections[begin + k] =
          AlignDepth(correspondences[k],
                     static_cast<double>(camera.Width()) / camera.Height(),
                     options_.alignment);
      progress.Step();
    });
  }
  for (size_t i = 0; i < views_.size(); ++i) {
    if (corrections[i]) views_[i].alignment.Append(*corrections[i]);
  }
  // They have the alignment before.
  loaded_.clear();
}

}  // namespace dgsfm
