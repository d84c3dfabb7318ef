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

// An element of a track: its image, by a number from 0 on, and its part of it.
struct Place {
  uint32_t image;
  uint8_t part;
};

// The places of the elements of all tracks.
class TrackPlaces {
 public:
  TrackPlaces(const Scene& scene, const std::vector<colmap::Track>& tracks) {
    std::unordered_map<colmap::image_t, uint32_t> numbers;
    begins_.reserve(tracks.size() + 1);
    for (const colmap::Track& track : tracks) {
      begins_.push_back(places_.size());
      for (const colmap::TrackElement& element : track.Elements()) {
        const auto number =
            numbers.emplace(element.image_id, uint32_t(images_.size()));
        if (number.second) images_.push_back(ImageOf(scene, element.image_id));
        places_.push_back({number.first->second,
                           PartOf(images_[number.first->second], element)});
      }
    }
    begins_.push_back(places_.size());
  }

  size_t NumImages() const { return images_.size(); }
  const Place* Begin(size_t track) const { return &places_[begins_[track]]; }
  const Place* End(size_t track) const { return Begin(track) + Length(track); }
  size_t Length(size_t track) const {
    return begins_[track + 1] - begins_[track];
  }

 private:
  struct ImageWithSize {
    const colmap::Image* image;
    size_t width;
    size_t height;
  };

  static ImageWithSize ImageOf(const Scene& scene, colmap::image_t image_id) {
    const colmap::Image& image = scene.images.at(image_id);
    const colmap::Camera& camera = scene.cameras.at(image.CameraId());
    return {&image, camera.Width(), camera.Height()};
  }

  static uint8_t PartOf(const ImageWithSize& image,
                        const colmap::TrackElement& element) {
    const Eigen::Vector2d xy = image.image->Point2D(element.point2D_idx).XY();
    const auto part = [](double coordinate, size_t size) {
      const double scaled = kNumPartsPerSide * coordinate / double(size);
      return int(std::clamp(scaled, 0.0, kNumPartsPerSide - 1.0));
    };
    return uint8_t(part(xy.y(), image.height) * kNumPartsPerSide +
                   part(xy.x(), image.width));
  }

  std::vector<ImageWithSize> images_;
  std::vector<Place> places_;
  std::vector<size_t> begins_;
};

// What the tracks that are chosen cover.
class Coverage {
 public:
  Coverage(const TrackOptions& options, size_t num_images)
      : max_num_per_image_(options.max_num_observations_per_image > 0
                               ? options.max_num_observations_per_image
                               : std::numeric_limits<int>::max()),
        images_(num_images) {}

  // What a track would add; 0 if too few of its images have room for it.
  double GainOf(const Place* begin, const Place* end) const {
    double gain = 0;
    int num_elements = 0;
    uint32_t previous = 0;
    for (const Place* place = begin; place != end; ++place) {
      const ImageCoverage& image = images_[place->image];
      if (IsFull(image)) continue;
      gain += Share(image.num_in_parts[place->part]);
      if (num_elements++ > 0) {
        const auto& links = images_[previous].num_links;
        const auto link = links.find(place->image);
        gain += kLinkWeight * Share(link == links.end() ? 0 : link->second);
      }
      previous = place->image;
    }
    return num_elements < 2 ? 0 : gain;
  }

  // Adds a track, which loses its elements in images that are full.
  void Add(const Place* places, colmap::Track* track) {
    colmap::Track kept;
    uint32_t previous = 0;
    for (size_t i = 0; i < track->Length(); ++i) {
      ImageCoverage& image = images_[places[i].image];
      if (IsFull(image)) continue;
      ++image.num_observations;
      ++image.num_in_parts[places[i].part];
      if (kept.Length() > 0) ++images_[previous].num_links[places[i].image];
      previous = places[i].image;
      kept.AddElement(track->Element(i));
    }
    *track = std::move(kept);
  }

 private:
  struct ImageCoverage {
    int num_observations = 0;
    std::array<int, kNumPartsPerSide* kNumPartsPerSide> num_in_parts = {};
    // Number of tracks to each image that follows this one in them.
    std::unordered_map<uint32_t, int> num_links;
  };

  static double Share(int count) { return 1.0 / (1 + count); }

  bool IsFull(const ImageCoverage& image) const {
    return image.num_observations >= max_num_per_image_;
  }

  const int max_num_per_image_;
  std::vector<ImageCoverage> images_;
};

}  // namespace

std::vector<colmap::Track> SelectTracks(const TrackOptions& options,
                                        const Scene& scene,
                                        std::vector<colmap::Track> tracks) {
  const size_t max_num_tracks = options.max_num_tracks > 0
                                    ? size_t(options.max_num_tracks)
                                    : tracks.size();
  const TrackPlaces places(scene, tracks);
  Coverage coverage(options, places.NumImages());
  const auto gain_of = [&](size_t i) {
    return coverage.GainOf(places.Begin(i), places.End(i));
  };
  // Gains only fall while tracks are chosen, so that the former gain of the
  // next one bounds those of all others. Of equal ones the first comes first.
  using Candidate = std::pair<double, int64_t>;
  std::vector<Candidate> all;
  all.reserve(tracks.size());
  for (size_t i = 0; i < tracks.size(); ++i) {
    all.emplace_back(gain_of(i), -int64_t(i));
  }
  std::priority_queue<Candidate> candidates(std::less<Candidate>(),
                                            std::move(all));
  std::vector<bool> is_selected(tracks.size(), false);
  size_t num_selected = 0;
  while (!candidates.empty() && num_selected < max_num_tracks) {
    const int64_t place = candidates.top().second;
    candidates.pop();
    const size_t i = size_t(-place);
    const double gain = gain_of(i);
    if (gain == 0) continue;
    if (!candidates.empty() &&
        gain < kMinShareOfLargest * candidates.top().first) {
      candidates.emplace(gain, place);
      continue;
    }
    coverage.Add(places.Begin(i), &tracks[i]);
    is_selected[i] = true;
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
