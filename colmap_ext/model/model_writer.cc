#include "colmap_ext/model/model_writer.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace dgsfm {
namespace {

// Hash maps list their content in an order that differs between libraries.
template <typename Map>
auto SortedIds(const Map& map) {
  std::vector<typename Map::key_type> ids;
  ids.reserve(map.size());
  for (const auto& [id, value] : map) ids.push_back(id);
  std::sort(ids.begin(), ids.end());
  return ids;
}

void WriteImages(const colmap::Reconstruction& model,
                 const std::string& folder) {
  std::vector<colmap::image_t> ids = model.RegImageIds();
  std::sort(ids.begin(), ids.end());
  ModelImagesFile file(folder, ids.size());
  for (const colmap::image_t id : ids) {
    const colmap::Image& image = model.Image(id);
    file.AddImage(image, image.NumPoints2D());
    for (const colmap::Point2D& point : image.Points2D()) {
      file.AddPoint2D(point.XY(), point.Point3DId());
    }
  }
  file.Commit();
}

void WritePoints(const colmap::Reconstruction& model,
                 const std::string& folder) {
  ModelPointsFile file(folder, model.NumPoints3D());
  for (const colmap::point3D_t id : SortedIds(model.Points3D())) {
    file.AddPoint(id, model.Point3D(id));
  }
  file.Commit();
}

}  // namespace

ModelFile::ModelFile(const std::string& folder,
                     const std::string& name,
                     size_t num_records)
    : path_(folder + "/" + name), file_(path_) {
  Write<uint64_t>(num_records);
}

void ModelFile::WriteVector(const Eigen::Ref<const Eigen::VectorXd>& numbers,
                            const std::string& owner) {
  // A model with NaN in it loads everywhere and fails much later.
  if (!numbers.allFinite()) {
    throw std::runtime_error(path_ + ": " + owner +
                             " has a number that is not finite");
  }
  for (const double number : numbers) file_.WriteNumber(number);
}

void ModelFile::WriteName(const std::string& name) {
  file_.Write({name.c_str(), name.size() + 1});
}

ModelImagesFile::ModelImagesFile(const std::string& folder, size_t num_images)
    : file_(folder, "images.bin", num_images) {}

void ModelImagesFile::AddImage(const colmap::Image& image,
                               size_t num_points2D) {
  owner_ = "image " + image.Name();
  file_.Write<uint32_t>(image.ImageId());
  file_.WriteVector(Eigen::Vector4d(image.Qvec().normalized()), owner_);
  file_.WriteVector(image.Tvec(), owner_);
  file_.Write<uint32_t>(image.CameraId());
  file_.WriteName(image.Name());
  file_.Write<uint64_t>(num_points2D);
}

void ModelImagesFile::AddPoint2D(const Eigen::Vector2d& xy,
                                 colmap::point3D_t point3D_id) {
  file_.WriteVector(xy, owner_);
  file_.Write<uint64_t>(point3D_id);
}

ModelPointsFile::ModelPointsFile(const std::string& folder, size_t num_points)
    : file_(folder, "points3D.bin", num_points) {}

void ModelPointsFile::AddPoint(colmap::point3D_t point3D_id,
                               const colmap::Point3D& point) {
  file_.Write<uint64_t>(point3D_id);
  file_.WriteVector(point.XYZ(), "point " + std::to_string(point3D_id));
  for (int i = 0; i < 3; ++i) file_.Write<uint8_t>(point.Color()[i]);
  // -1 is COLMAP's mark of an unknown error.
  file_.Write<double>(std::isfinite(point.Error()) ? point.Error() : -1);
  file_.Write<uint64_t>(point.Track().Length());
  for (const colmap::TrackElement& element : point.Track().Elements()) {
    file_.Write<uint32_t>(element.image_id);
    file_.Write<uint32_t>(element.point2D_idx);
  }
}

void WriteModelCameras(const colmap::Reconstruction& model,
                       const std::string& folder) {
  ModelFile file(folder, "cameras.bin", model.NumCameras());
  for (const colmap::camera_t id : SortedIds(model.Cameras())) {
    const colmap::Camera& camera = model.Camera(id);
    file.Write<uint32_t>(id);
    file.Write<int32_t>(camera.ModelId());
    file.Write<uint64_t>(camera.Width());
    file.Write<uint64_t>(camera.Height());
    file.WriteVector(Eigen::Map<const Eigen::VectorXd>(
                         camera.ParamsData(), Eigen::Index(camera.NumParams())),
                     "camera " + std::to_string(id));
  }
  file.Commit();
}

void WriteModel(const colmap::Reconstruction& model,
                const std::string& folder) {
  WriteModelCameras(model, folder);
  WriteImages(model, folder);
  WritePoints(model, folder);
}

}  // namespace dgsfm
