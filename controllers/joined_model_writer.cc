#include "controllers/joined_model_writer.h"

#include "colmap_ext/model/model_io.h"
#include "colmap_ext/model/model_writer.h"

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

namespace dgsfm {

namespace {

// COLMAP numbers points from 1.
colmap::point3D_t IdOfPoint(size_t point) {
  return colmap::point3D_t(point + 1);
}

// What each image sees, in increasing order of its key points.
class PointsOfImages {
 public:
  explicit PointsOfImages(const JoinedModel& model)
      : image_ids_(model.image_ids) {
    begins_.assign(image_ids_.size() + 1, 0);
    for (const auto& observation : model.observations) {
      ++begins_[observation.image + 1];
    }
    for (size_t i = 1; i < begins_.size(); ++i) begins_[i] += begins_[i - 1];
    points_.resize(model.observations.size());
    std::vector<size_t> ends(begins_.begin(), begins_.end() - 1);
    for (size_t point = 0; point < model.NumPoints(); ++point) {
      for (size_t i = model.begins[point]; i < model.begins[point + 1]; ++i) {
        const auto& observation = model.observations[i];
        points_[ends[observation.image]++] = {observation.point2D_idx,
                                              uint32_t(point)};
      }
    }
  }

  std::map<colmap::point2D_t, colmap::point3D_t> Of(
      colmap::image_t image_id) const {
    const auto found =
        std::lower_bound(image_ids_.begin(), image_ids_.end(), image_id);
    const auto index = size_t(found - image_ids_.begin());
    std::map<colmap::point2D_t, colmap::point3D_t> points;
    for (size_t i = begins_[index]; i < begins_[index + 1]; ++i) {
      points.emplace(points_[i].first, IdOfPoint(points_[i].second));
    }
    return points;
  }

 private:
  const std::vector<colmap::image_t>& image_ids_;
  std::vector<size_t> begins_;
  std::vector<std::pair<colmap::point2D_t, uint32_t>> points_;
};

void WriteImage(const colmap::Image& image,
                const std::vector<ModelObservation>& keypoints,
                const std::vector<Eigen::Vector2f>& added,
                const std::map<colmap::point2D_t, colmap::point3D_t>& points,
                ModelImagesFile* file) {
  file->AddImage(image, keypoints.size() + added.size());
  const auto add = [&](size_t point2D_idx, const Eigen::Vector2d& xy) {
    const auto found = points.find(colmap::point2D_t(point2D_idx));
    file->AddPoint2D(
        xy, found == points.end() ? colmap::kInvalidPoint3DId : found->second);
  };
  for (size_t i = 0; i < keypoints.size(); ++i) add(i, keypoints[i].xy);
  for (size_t i = 0; i < added.size(); ++i) {
    add(keypoints.size() + i, added[i].cast<double>());
  }
}

void WriteImages(const JoinedModel& model,
                 const std::vector<PartModel>& parts,
                 const AddedKeypoints& added_keypoints,
                 const std::string& folder) {
  const PointsOfImages points(model);
  ModelImagesFile file(folder, model.image_ids.size());
  std::set<colmap::image_t> written;
  for (const PartModel& part : parts) {
    std::map<std::string, colmap::image_t> ids;
    for (const auto& [image_id, image] : part.images) {
      if (!model.poses.ExistsImage(image_id)) continue;
      if (!written.insert(image_id).second) continue;
      ids.emplace(model.poses.Image(image_id).Name(), image_id);
    }
    if (ids.empty()) continue;
    size_t num_found = 0;
    VisitModelImages(part.name, [&](const ModelImageRecord& record) {
      const auto id = ids.find(record.name);
      if (id == ids.end()) return;
      ++num_found;
      const colmap::image_t image_id = id->second;
      const auto added = added_keypoints.find(image_id);
      WriteImage(model.poses.Image(image_id),
                 record.image.observations,
                 added == added_keypoints.end() ? std::vector<Eigen::Vector2f>()
                                                : added->second,
                 points.Of(image_id),
                 &file);
    });
    if (num_found != ids.size()) {
      throw std::runtime_error("model " + part.name +
                               " changed while it was joined");
    }
  }
  file.Commit();
}

void WritePoints(const JoinedModel& model, const std::string& folder) {
  ModelPointsFile file(folder, model.NumPoints());
  for (size_t i = 0; i < model.NumPoints(); ++i) {
    colmap::Point3D point;
    point.SetXYZ(model.points[i]);
    point.SetColor(model.colors[i]);
    for (size_t j = model.begins[i]; j < model.begins[i + 1]; ++j) {
      const auto& observation = model.observations[j];
      point.Track().AddElement(model.image_ids[observation.image],
                               observation.point2D_idx);
    }
    point.SetError(model.point_errors_px.empty() ? -1
                                                 : model.point_errors_px[i]);
    file.AddPoint(IdOfPoint(i), point);
  }
  file.Commit();
}

}  // namespace

void WriteJoinedModel(const JoinedModel& model,
                      const std::vector<PartModel>& parts,
                      const AddedKeypoints& added_keypoints,
                      const std::string& folder) {
  WriteModelCameras(model.poses, folder);
  WriteImages(model, parts, added_keypoints, folder);
  WritePoints(model, folder);
}

}  // namespace dgsfm
