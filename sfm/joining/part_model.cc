#include "sfm/joining/part_model.h"

#include <algorithm>
#include <tuple>
#include <unordered_set>

namespace dgsfm {

namespace {

using Observation = PartModel::Observation;
using PartImage = PartModel::PartImage;

// Calls visit(observation1, observation2) for those of one key point.
template <typename Visit>
void VisitShared(const PartImage& image1,
                 const PartImage& image2,
                 const Visit& visit) {
  auto it = image2.observations.begin();
  for (const Observation& observation : image1.observations) {
    while (it != image2.observations.end() &&
           it->point2D_idx < observation.point2D_idx) {
      ++it;
    }
    if (it == image2.observations.end()) return;
    if (it->point2D_idx == observation.point2D_idx) visit(observation, *it);
  }
}

// Whether both list the same key points, as far as both see points with them.
bool HaveSameKeypoints(const PartImage& image1, const PartImage& image2) {
  bool are_same = image1.num_keypoints == image2.num_keypoints;
  VisitShared(image1, image2, [&](const auto& a, const auto& b) {
    are_same &= a.xy_px == b.xy_px;
  });
  return are_same;
}

// Key points of an image by their places.
class KeypointNumbers {
 public:
  explicit KeypointNumbers(const PartImage& image)
      : num_keypoints_(image.num_keypoints) {
    for (const Observation& observation : image.observations) {
      numbers_.emplace(Place(observation.xy_px), observation.point2D_idx);
    }
  }

  // The number of a key point, a new one behind the others if it has none.
  colmap::point2D_t NumberOf(const Eigen::Vector2f& xy_px,
                             std::vector<Eigen::Vector2f>* added) {
    const auto [it, is_new] = numbers_.emplace(
        Place(xy_px), colmap::point2D_t(num_keypoints_ + added->size()));
    if (is_new) added->push_back(xy_px);
    return it->second;
  }

 private:
  using PlacePx = std::pair<float, float>;
  static PlacePx Place(const Eigen::Vector2f& xy_px) {
    return {xy_px.x(), xy_px.y()};
  }

  size_t num_keypoints_;
  std::map<PlacePx, colmap::point2D_t> numbers_;
};

// Each key point once, the first observation of several.
void SortObservations(std::vector<Observation>* observations) {
  const auto number = [](const Observation& observation) {
    return std::make_tuple(observation.point2D_idx, observation.point);
  };
  std::sort(
      observations->begin(),
      observations->end(),
      [&](const auto& a, const auto& b) { return number(a) < number(b); });
  observations->erase(std::unique(observations->begin(),
                                  observations->end(),
                                  [](const auto& a, const auto& b) {
                                    return a.point2D_idx == b.point2D_idx;
                                  }),
                      observations->end());
}

}  // namespace

AddedKeypoints UnifyKeypoints(std::vector<PartModel>* parts) {
  // The first part of each image.
  std::map<colmap::image_t, const PartImage*> firsts;
  std::map<colmap::image_t, KeypointNumbers> numbers;
  AddedKeypoints added;
  for (PartModel& part : *parts) {
    for (auto& [image_id, image] : part.images) {
      const auto [first, is_first] = firsts.emplace(image_id, &image);
      if (is_first || HaveSameKeypoints(*first->second, image)) continue;
      KeypointNumbers& known =
          numbers.try_emplace(image_id, *first->second).first->second;
      for (Observation& observation : image.observations) {
        observation.point2D_idx =
            known.NumberOf(observation.xy_px, &added[image_id]);
      }
      SortObservations(&image.observations);
    }
  }
  return added;
}

std::vector<std::pair<uint32_t, uint32_t>> SharedPoints(
    const PartImage& image1, const PartImage& image2) {
  std::vector<std::pair<uint32_t, uint32_t>> shared;
  VisitShared(image1, image2, [&](const auto& a, const auto& b) {
    shared.emplace_back(a.point, b.point);
  });
  return shared;
}

}  // namespace dgsfm
