#include "sfm/mapping/track_selection.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <queue>
#include <unordered_map>
#include <utility>

namespace dgsfm {

namespace {

// Parts of an image along each side that tracks are to be spread over.
constexpr int kNumPartsPerSide = 8;
// What the first track of a pair of images counts, relative to the first
// observation in a part of an image.
constexpr double kLinkWeight = 8;
// Gain of a track that is chosen, at least, of the largest: to find the very
// largest each time takes many times as long.
constexpr double kMinShareOfLargest = 0.8;

// What the tracks that are chosen cover.
class Coverage {
 public:
  Coverage(const TrackOptions& options, const Scene& scene)
      : max_num_per_image_(options.max_num_observations_per_image > 0
                               ? options.max_num_observations_per_image
                               : std::numeric_limits<int>::max()),
        scene_(scene) {}

  // What the track would add; 0 if too few of its images have room for it.
  double GainOf(const colmap::Track& track) const {
    double gain = 0;
    int num_elements = 0;
    colmap::image_t previous = colmap::kInvalidImageId;
    for (const colmap::TrackElement& element : track.Elements()) {
      const auto image = images_.find(element.image_id);
      if (image != images_.end() && IsFull(image->second)) continue;
      gain += Share(image == images_.end()
                        ? 0
                        : image->second.num_in_parts[PartOf(element)]);
      if (num_elements++ > 0) {
        const auto link =
            links_.find(PairIdOfImages(previous, element.image_id));
        gain += kLinkWeight * Share(link == links_.end() ? 0 : link->second);
      }
      previous = element.image_id;
    }
    return num_elements < 2 ? 0 : gain;
  }

  // Adds the track, which loses its elements in images that are full.
  void Add(colmap::Track* track) {
    colmap::Track kept;
    colmap::image_t previous = colmap::kInvalidImageId;
    for (const colmap::TrackElement& element : track->Elements()) {
      ImageCoverage& image = images_[element.image_id];
      if (IsFull(image)) continue;
      ++image.num_observations;
      ++image.num_in_parts[PartOf(element)];
      if (kept.Length() > 0) {
        ++links_[PairIdOfImages(previous, element.image_id)];
      }
      previous = element.image_id;
      kept.AddElement(element);
    }
    *track = std::move(kept);
  }

 private:
  struct ImageCoverage {
    int num_observations = 0;
    std::array<int, kNumPartsPerSide* kNumPartsPerSide> num_in_parts = {};
  };

  static double Share(int count) { return 1.0 / (1 + count); }

  bool IsFull(const ImageCoverage& image) const {
    return image.num_observations >= max_num_per_image_;
  }

  size_t PartOf(const colmap::TrackElement& element) const {
    const colmap::Image& image = scene_.images.at(element.image_id);
    const colmap::Camera& camera = scene_.cameras.at(image.CameraId());
    const Eigen::Vector2d xy = image.Point2D(element.point2D_idx).XY();
    const auto part = [](double coordinate, size_t size) {
      const double scaled = kNumPartsPerSide * coordinate / double(size);
      return size_t(std::clamp(scaled, 0.0, kNumPartsPerSide - 1.0));
    };
    return part(xy.y(), camera.Height()) * kNumPartsPerSide +
           part(xy.x(), camera.Width());
  }

  const int max_num_per_image_;
  const Scene& scene_;
  std::unordered_map<colmap::image_t, ImageCoverage> images_;
  // Number of tracks by pair of images.
  std::unordered_map<colmap::image_pair_t, int> links_;
};

}  // namespace

std::vector<colmap::Track> SelectTracks(const TrackOptions& options,
                                        const Scene& scene,
                                        std::vector<colmap::Track> tracks) {
  const size_t max_num_tracks = options.max_num_tracks > 0
                                    ? size_t(options.max_num_tracks)
                                    : tracks.size();
  Coverage coverage(options, scene);
  // Gains only fall while tracks are chosen, so that the former gain of the
  // next one bounds those of all others. Of equal ones the first comes first.
  using Candidate = std::pair<double, int64_t>;
  std::vector<Candidate> all;
  all.reserve(tracks.size());
  for (size_t i = 0; i < tracks.size(); ++i) {
    all.emplace_back(coverage.GainOf(tracks[i]), -int64_t(i));
  }
  std::priority_queue<Candidate> candidates(std::less<Candidate>(),
                                            std::move(all));
  std::vector<bool> is_selected(tracks.size(), false);
  size_t num_selected = 0;
  while (!candidates.empty() && num_selected < max_num_tracks) {
    const int64_t place = candidates.top().second;
    candidates.pop();
    colmap::Track& track = tracks[size_t(-place)];
    const double gain = coverage.GainOf(track);
    if (gain == 0) continue;
    if (!candidates.empty() &&
        gain < kMinShareOfLargest * candidates.top().first) {
      candidates.emplace(gain, place);
      continue;
    }
    coverage.Add(&track);
    is_selected[size_t(-place)] = true;
    ++num_selected;
  }
  std::vector<colmap::Track> selected;
  selected.reserve(num_selected);
  for (size_t i = 0; i < tracks.size(); ++i) {
    if (is_selected[i]) selected.push_back(std::move(tracks[i]));
  }
  return selected;
}

UsedKeypoints KeypointsOf(const std::vector<colmap::Track>& tracks) {
  UsedKeypoints used;
  for (const colmap::Track& track : tracks) {
    for (const colmap::TrackElement& element : track.Elements()) {
      std::vector<bool>& of_image = used[element.image_id];
      if (of_image.size() <= element.point2D_idx) {
        of_image.resize(element.point2D_idx + 1, false);
      }
      of_image[element.point2D_idx] = true;
    }
  }
  return used;
}

bool IsUsed(const UsedKeypoints& used,
            colmap::image_t image_id,
            colmap::point2D_t point2D_idx) {
  if (used.empty()) return true;
  const auto of_image = used.find(image_id);
  return of_image != used.end() && point2D_idx < of_image->second.size() &&
         of_image->second[point2D_idx];
}

}  // namespace dgsfm
