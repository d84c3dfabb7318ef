#include "sfm/joining/joined_model.h"

#include "colmap_ext/check.h"
#include "colmap_ext/pose_access.h"
#include "sfm/georeferencing/model_alignment.h"
#include "sfm/joining/camera_joining.h"

#include <algorithm>
#include <limits>
#include <map>
#include <tuple>
#include <utility>

namespace dgsfm {

namespace {

using PartImage = PartModel::PartImage;

constexpr uint32_t kNoPoint = std::numeric_limits<uint32_t>::max();

// An image of a group, with the part whose pose it takes, as an index in the
// group.
struct Choice {
  size_t part = 0;
  size_t num_observations = 0;
  size_t num_parts = 0;
};

std::map<colmap::image_t, Choice> ChooseParts(
    const std::vector<PartModel>& parts, const PartGroup& group) {
  std::map<colmap::image_t, Choice> choices;
  for (size_t i = 0; i < group.parts.size(); ++i) {
    for (const auto& [image_id, image] : parts[group.parts[i]].images) {
      Choice& choice = choices[image_id];
      if (choice.num_parts == 0 ||
          image.observations.size() > choice.num_observations) {
        choice.part = i;
        choice.num_observations = image.observations.size();
      }
      ++choice.num_parts;
    }
  }
  return choices;
}

// The observations of each point of a part, point after point.
class Tracks {
 public:
  struct Element {
    uint32_t image = 0;
    const PartModel::Observation* observation = nullptr;
  };

  Tracks(const PartModel& part, const std::vector<colmap::image_t>& image_ids) {
    begins_.assign(part.points.size() + 1, 0);
    for (const auto& [image_id, image] : part.images) {
      for (const auto& observation : image.observations) {
        ++begins_[observation.point + 1];
      }
    }
    for (size_t i = 1; i < begins_.size(); ++i) begins_[i] += begins_[i - 1];
    elements_.resize(begins_.back());
    std::vector<size_t> ends(begins_.begin(), begins_.end() - 1);
    for (const auto& [image_id, image] : part.images) {
      const auto found =
          std::lower_bound(image_ids.begin(), image_ids.end(), image_id);
      const auto index = uint32_t(found - image_ids.begin());
      for (const auto& observation : image.observations) {
        elements_[ends[observation.point]++] = {index, &observation};
      }
    }
  }

  const Element* begin(size_t point) const {
    return elements_.data() + begins_[point];
  }
  const Element* end(size_t point) const {
    return elements_.data() + begins_[point + 1];
  }

 private:
  std::vector<size_t> begins_;
  std::vector<Element> elements_;
};

// Points of all parts; those that share an observation are one.
class PointJoiner {
 public:
  // `is_shared` has the images of several parts; num_observations is that of
  // all parts.
  PointJoiner(const std::vector<colmap::image_t>& image_ids,
              const std::vector<bool>& is_shared,
              size_t num_observations)
      : image_ids_(image_ids),
        is_shared_(is_shared),
        shared_(image_ids.size()) {
    entries_.reserve(num_observations);
  }

  void Add(const PartModel& part, const Similarity3d& group_from_part) {
    const Tracks tracks(part, image_ids_);
    for (size_t i = 0; i < part.points.size(); ++i) {
      const size_t length = size_t(tracks.end(i) - tracks.begin(i));
      if (length == 0) continue;
      const uint32_t target = FindTarget(tracks.begin(i), tracks.end(i));
      for (auto it = tracks.begin(i); it != tracks.end(i); ++it) {
        AddObservation(*it, target);
      }
      Point& point = points_[target];
      if (length <= point.num_seeing) continue;
      point.num_seeing = length;
      point.xyz = group_from_part * part.points[i];
      point.color = part.colors[i];
    }
  }

  // Points of two or more images, by their first observations.
  void WriteTo(JoinedModel* model) {
    const auto place = [](const Entry& entry) {
      return std::make_tuple(
          entry.point, entry.observation.image, entry.observation.point2D_idx);
    };
    std::sort(
        entries_.begin(), entries_.end(), [&](const auto& a, const auto& b) {
          return place(a) < place(b);
        });
    // An image sees a point once.
    entries_.erase(std::unique(entries_.begin(),
                               entries_.end(),
                               [](const auto& a, const auto& b) {
                                 return a.point == b.point &&
                                        a.observation.image ==
                                            b.observation.image;
                               }),
                   entries_.end());
    model->observations.reserve(entries_.size());
    model->begins.push_back(0);
    for (size_t first = 0; first < entries_.size();) {
      size_t last = first;
      const uint32_t point = entries_[first].point;
      while (last < entries_.size() && entries_[last].point == point) ++last;
      if (last - first >= 2) {
        for (size_t i = first; i < last; ++i) {
          model->observations.push_back(entries_[i].observation);
        }
        model->begins.push_back(model->observations.size());
        model->points.push_back(points_[point].xyz);
        model->colors.push_back(points_[point].color);
      }
      first = last;
    }
  }

 private:
  struct Point {
    // Place and colour in the part where most images see it.
    Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
    Eigen::Vector3ub color = Eigen::Vector3ub::Zero();
    size_t num_seeing = 0;
  };
  struct Entry {
    uint32_t point = 0;
    JoinedModel::Observation observation;
  };

  // The point of a key point of an image of several parts.
  uint32_t* PointOf(const Tracks::Element& element) {
    std::vector<uint32_t>& points = shared_[element.image];
    const size_t index = element.observation->point2D_idx;
    if (index >= points.size()) points.resize(index + 1, kNoPoint);
    return &points[index];
  }

  void AddObservation(const Tracks::Element& element, uint32_t target) {
    if (is_shared_[element.image]) {
      uint32_t* point = PointOf(element);
      // What another point has stays with it.
      if (*point != kNoPoint) return;
      *point = target;
    }
    entries_.push_back({target,
                        {element.image,
                         element.observation->point2D_idx,
                         element.observation->xy_px}});
  }

  // The point that most observations have already, or a new one.
  uint32_t FindTarget(const Tracks::Element* begin,
                      const Tracks::Element* end) {
    std::map<uint32_t, size_t> votes;
    for (auto it = begin; it != end; ++it) {
      if (!is_shared_[it->image]) continue;
      const uint32_t point = *PointOf(*it);
      if (point != kNoPoint) ++votes[point];
    }
    if (votes.empty()) {
      points_.emplace_back();
      return uint32_t(points_.size() - 1);
    }
    return std::max_element(
               votes.begin(),
               votes.end(),
               [](const auto& a, const auto& b) { return a.second < b.second; })
        ->first;
  }

  const std::vector<colmap::image_t>& image_ids_;
  const std::vector<bool>& is_shared_;
  std::vector<Point> points_;
  std::vector<Entry> entries_;
  // Points of the key points of images of several parts.
  std::vector<std::vector<uint32_t>> shared_;
};

void AddPoses(const Scene& scene,
              const std::vector<PartModel>& parts,
              const PartGroup& group,
              const std::map<colmap::image_t, Choice>& choices,
              JoinedModel* model) {
  CameraJoiner cameras(scene, parts, group);
  std::map<colmap::image_t, colmap::camera_t> camera_of_image;
  for (const auto& [image_id, choice] : choices) {
    camera_of_image[image_id] =
        cameras.CameraOf(image_id, group.parts[choice.part]);
  }
  cameras.WriteTo(&model->poses);
  for (const auto& [image_id, choice] : choices) {
    const PartImage& part_image =
        parts[group.parts[choice.part]].images.at(image_id);
    const Similarity3d& frame = group.group_from_part[choice.part];
    const Eigen::Quaterniond rotation =
        (part_image.cam_from_part.rotation * frame.rotation.conjugate())
            .normalized();
    colmap::Image image = scene.images.at(image_id);
    image.SetCameraId(camera_of_image.at(image_id));
    SetCamFromWorld({rotation, Eigen::Vector3d::Zero()}, &image);
    SetCenterInWorld(frame * part_image.cam_from_part.TargetOriginInSource(),
                     &image);
    model->poses.AddImage(image);
    model->poses.RegisterImage(image_id);
  }
}

}  // namespace

void JoinedModel::Transform(const Similarity3d& new_from_old) {
  TransformModel(new_from_old, &poses);
  for (Eigen::Vector3d& point : points) point = new_from_old * point;
}

void JoinedModel::Keep(const std::vector<bool>& keep) {
  DGSFM_CHECK(keep.size() == observations.size());
  point_errors_px.clear();
  size_t num_points = 0;
  size_t num_observations = 0;
  size_t begin = 0;
  for (size_t point = 0; point < points.size(); ++point) {
    const size_t end = begins[point + 1];
    const size_t first = num_observations;
    for (size_t i = begin; i < end; ++i) {
      if (keep[i]) observations[num_observations++] = observations[i];
    }
    begin = end;
    if (num_observations - first < 2) {
      num_observations = first;
      continue;
    }
    points[num_points] = points[point];
    colors[num_points] = colors[point];
    begins[++num_points] = num_observations;
  }
  points.resize(num_points);
  colors.resize(num_points);
  begins.resize(num_points + 1);
  observations.resize(num_observations);
}

JoinedModel JoinGroup(const Scene& scene,
                      const PartGroup& group,
                      std::vector<PartModel>* parts) {
  const std::map<colmap::image_t, Choice> choices = ChooseParts(*parts, group);
  JoinedModel model;
  std::vector<bool> is_shared;
  for (const auto& [image_id, choice] : choices) {
    model.image_ids.push_back(image_id);
    is_shared.push_back(choice.num_parts > 1);
  }
  AddPoses(scene, *parts, group, choices, &model);
  size_t num_observations = 0;
  for (const int part : group.parts) {
    for (const auto& [image_id, image] : (*parts)[part].images) {
      num_observations += image.observations.size();
    }
  }
  PointJoiner joiner(model.image_ids, is_shared, num_observations);
  for (size_t i = 0; i < group.parts.size(); ++i) {
    PartModel& part = (*parts)[group.parts[i]];
    joiner.Add(part, group.group_from_part[i]);
    std::vector<uint32_t>& block = model.blocks.emplace_back();
    for (auto& [image_id, image] : part.images) {
      image.observations = {};
      const auto found = std::lower_bound(
          model.image_ids.begin(), model.image_ids.end(), image_id);
      block.push_back(uint32_t(found - model.image_ids.begin()));
    }
    part.points = {};
    part.colors = {};
  }
  joiner.WriteTo(&model);
  return model;
}

}  // namespace dgsfm
