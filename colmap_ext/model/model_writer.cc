#include "colmap_ext/model/model_writer.h"

#include "colmap_ext/output_file.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace dgsfm {
namespace {

// One file of a model; its numbers are finite.
class ModelFile {
 public:
  ModelFile(const std::string& folder, const std::string& name)
      : path_(folder + "/" + name), file_(path_) {}

  template <typename T>
  void Write(T number) {
    file_.WriteNumber(number);
  }

  // `owner` is what the numbers belong to, for the message.
  template <typename Numbers>
  void WriteAll(const Numbers& numbers, const std::string& owner) {
    for (Eigen::Index i = 0; i < Eigen::Index(numbers.size()); ++i) {
      // A model with NaN in it loads everywhere and fails much later.
      if (!std::isfinite(numbers[i])) {
        throw std::runtime_error(path_ + ": " + owner +
                                 " has a number that is not finite");
      }
      file_.WriteNumber<double>(numbers[i]);
    }
  }

  void WriteName(const std::string& name) {
    file_.Write({name.c_str(), name.size() + 1});
  }

  void Commit() { file_.Commit(); }

 private:
  const std::string path_;
  OutputFile file_;
};

// Hash maps list their content in an order that differs between libraries.
template <typename Map>
auto SortedIds(const Map& map) {
  std::vector<typename Map::key_type> ids;
  ids.reserve(map.size());
  for (const auto& [id, value] : map) ids.push_back(id);
  std::sort(ids.begin(), ids.end());
  return ids;
}

void WriteCameras(const colmap::Reconstruction& model,
                  const std::string& folder) {
  ModelFile file(folder, "cameras.bin");
  file.Write<uint64_t>(model.NumCameras());
  for (const colmap::camera_t id : SortedIds(model.Cameras())) {
    const colmap::Camera& camera = model.Camera(id);
    file.Write<uint32_t>(id);
    file.Write<int32_t>(camera.ModelId());
    file.Write<uint64_t>(camera.Width());
    file.Write<uint64_t>(camera.Height());
    file.WriteAll(camera.Params(), "camera " + std::to_string(id));
  }
  file.Commit();
}

void WriteImages(const colmap::Reconstruction& model,
                 const std::string& folder) {
  ModelFile file(folder, "images.bin");
  std::vector<colmap::image_t> ids = model.RegImageIds();
  std::sort(ids.begin(), ids.end());
  file.Write<uint64_t>(ids.size());
  for (const colmap::image_t id : ids) {
    const colmap::Image& image = model.Image(id);
    const std::string owner = "image " + image.Name();
    file.Write<uint32_t>(id);
    file.WriteAll(Eigen::Vector4d(image.Qvec().normalized()), owner);
    file.WriteAll(image.Tvec(), owner);
    file.Write<uint32_t>(image.CameraId());
    file.WriteName(image.Name());
    file.Write<uint64_t>(image.NumPoints2D());
    for (const colmap::Point2D& point : image.Points2D()) {
      file.WriteAll(point.XY(), owner);
      file.Write<uint64_t>(point.Point3DId());
    }
  }
  file.Commit();
}

void WritePoints(const colmap::Reconstruction& model,
                 const std::string& folder) {
  ModelFile file(folder, "points3D.bin");
  file.Write<uint64_t>(model.NumPoints3D());
  for (const colmap::point3D_t id : SortedIds(model.Points3D())) {
    const colmap::Point3D& point = model.Point3D(id);
    file.Write<uint64_t>(id);
    file.WriteAll(point.XYZ(), "point " + std::to_string(id));
    for (int i = 0; i < 3; ++i) file.Write<uint8_t>(point.Color()[i]);
    // -1 is COLMAP's mark of an unknown error.
    file.Write<double>(std::isfinite(point.Error()) ? point.Error() : -1);
    file.Write<uint64_t>(point.Track().Length());
    for (const colmap::TrackElement& element : point.Track().Elements()) {
      file.Write<uint32_t>(element.image_id);
      file.Write<uint32_t>(element.point2D_idx);
    }
  }
  file.Commit();
}

}  // namespace

void WriteModel(const colmap::Reconstruction& model,
                const std::string& folder) {
  WriteCameras(model, folder);
  WriteImages(model, folder);
  WritePoints(model, folder);
}

}  // namespace dgsfm
