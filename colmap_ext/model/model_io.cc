#include "colmap_ext/model/model_io.h"

#include <colmap/base/camera_models.h>
#include <colmap/util/endian.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

constexpr double kMaxNumber = 1e30;
constexpr uint64_t kMaxImageSize = 1000000;  // [px]
// Least sizes of records in binary files: camera id, model, width and height;
constexpr size_t kMinCameraSize = 4 + 4 + 8 + 8;
// image id, pose, camera id, terminating zero of the name, number of points;
constexpr size_t kMinImageSize = 4 + 7 * 8 + 4 + 1 + 8;
// point id, position, colour, error, length of the track.
constexpr size_t kMinPointSize = 8 + 3 * 8 + 3 + 8 + 8;

// A binary file, never read beyond its end. It has the same methods as
// TextFile, so that one function reads either form.
class BinaryFile {
 public:
  explicit BinaryFile(const fs::path& path)
      : path_(path), stream_(path, std::ios::binary) {
    if (!stream_) throw std::runtime_error("cannot read " + path.string());
    num_left_ = fs::file_size(path);
    size_ = num_left_;
  }

  // Goes to the next camera, image or point, which has at least record_size
  // bytes; false behind the last one.
  bool NextRecord(size_t record_size) {
    if (!num_records_) num_records_ = ReadCount(record_size);
    return (*num_records_)-- > 0;
  }

  template <typename T>
  void Read(T* value) {
    Take(sizeof(T));
    *value = colmap::ReadBinaryLittleEndian<T>(&stream_);
    if (!stream_) Fail("cannot be read");
  }

  std::string ReadName() {
    std::string name;
    for (char c = 0; Read(&c), c != 0;) name += c;
    return name;
  }

  void ReadColor(uint8_t* value) { Read(value); }
  int ReadCameraModel() {
    int model_id = 0;
    Read(&model_id);
    return model_id;
  }

  // Begins the list of what an image observes.
  void BeginObservations() { num_observations_ = ReadCount(3 * 8); }
  bool NextObservation() { return num_observations_-- > 0; }

  // Leaves out the reprojection error and the track, whose length it returns.
  uint64_t SkipErrorAndTrack() {
    constexpr size_t kTrackElementSize = 2 * 4;
    double error = 0;
    Read(&error);
    const uint64_t length = ReadCount(kTrackElementSize);
    Take(kTrackElementSize * length);
    stream_.seekg(kTrackElementSize * length, std::ios::cur);
    return length;
  }

  [[noreturn]] void Fail(const std::string& problem) const {
    throw std::runtime_error(path_.string() + " " + problem + " (byte " +
                             std::to_string(size_ - num_left_) + " of " +
                             std::to_string(size_) + ")");
  }

 private:
  // Number of following records; damaged ones do not fit into the file.
  uint64_t ReadCount(size_t record_size) {
    uint64_t count = 0;
    Read(&count);
    if (count > num_left_ / record_size) Fail("is truncated");
    return count;
  }

  void Take(uint64_t num_bytes) {
    if (num_bytes > num_left_) Fail("is truncated");
    num_left_ -= num_bytes;
  }

  fs::path path_;
  std::ifstream stream_;
  uint64_t size_ = 0;
  uint64_t num_left_ = 0;
  std::optional<uint64_t> num_records_;
  uint64_t num_observations_ = 0;
};

// A text file, whose records are lines; images have a second line, which may be
// empty.
class TextFile {
 public:
  explicit TextFile(const fs::path& path) : path_(path), stream_(path) {
    if (!stream_) throw std::runtime_error("cannot read " + path.string());
  }

  // The next line that is neither empty nor a comment.
  bool NextRecord(size_t) {
    while (NextLine()) {
      line_ >> std::ws;
      if (!line_.eof() && line_.peek() != '#') return true;
    }
    return false;
  }

  template <typename T>
  void Read(T* value) {
    if (!(line_ >> *value)) Fail("is malformed");
  }

  // The rest of the line: names may have spaces in them.
  std::string ReadName() {
    std::string name;
    std::getline(line_ >> std::ws, name);
    return name;
  }

  void ReadColor(uint8_t* value) {
    int number = 0;
    Read(&number);
    *value = std::clamp(number, 0, 255);
  }
  int ReadCameraModel() {
    std::string name;
    Read(&name);
    const bool is_known = colmap::ExistsCameraModelWithName(name);
    return is_known ? colmap::CameraModelNameToId(name) : -1;
  }

  void BeginObservations() { NextLine(); }
  bool NextObservation() {
    line_ >> std::ws;
    return !line_.eof();
  }

  uint64_t SkipErrorAndTrack() {
    std::string error;
    Read(&error);
    uint64_t length = 0;
    for (; NextObservation(); ++length) {
      colmap::image_t image_id = 0;
      colmap::point2D_t point2D_idx = 0;
      Read(&image_id);
      Read(&point2D_idx);
    }
    return length;
  }

  [[noreturn]] void Fail(const std::string& problem) const {
    throw std::runtime_error(path_.string() + " " + problem + " (line " +
                             std::to_string(line_number_) + ")");
  }

 private:
  // The next line, empty or not.
  bool NextLine() {
    ++line_number_;
    std::string line;
    if (!std::getline(stream_, line)) {
      if (stream_.bad()) Fail("cannot be read");
      return false;
    }
    if (!line.empty() && line.back() == '\r') line.pop_back();
    line_.clear();
    line_.str(line);
    return true;
  }

  fs::path path_;
  std::ifstream stream_;
  std::istringstream line_;
  size_t line_number_ = 0;
};

// The binary or else the text file of a folder.
std::optional<fs::path> FindFile(const fs::path& folder,
                                 const std::string& stem) {
  for (const char* extension : {".bin", ".txt"}) {
    const fs::path path = folder / (stem + extension);
    if (fs::is_regular_file(path)) return path;
  }
  return std::nullopt;
}

// Calls read(file) with a BinaryFile or a TextFile.
template <typename Read>
void ReadFile(const std::string& folder,
              const std::string& stem,
              const Read& read) {
  const std::optional<fs::path> path = FindFile(folder, stem);
  if (!path) {
    throw std::runtime_error(folder + " has neither " + stem + ".bin nor " +
                             stem + ".txt");
  }
  if (path->extension() == ".bin") {
    BinaryFile file(*path);
    read(file);
  } else {
    TextFile file(*path);
    read(file);
  }
}

// Refuses what overflows where numbers are squared or become depths of 32 bits.
template <typename File, typename Vector>
void ReadVector(File& file, const std::string& problem, Vector* vector) {
  for (double& value : *vector) {
    file.Read(&value);
    if (!(std::abs(value) <= kMaxNumber)) file.Fail(problem);
  }
}

template <typename File>
Rigid3d ReadPose(File& file) {
  Eigen::Vector4d qvec;
  Eigen::Vector3d translation;
  ReadVector(file, "has an invalid pose", &qvec);
  ReadVector(file, "has an invalid pose", &translation);
  if (!(qvec.norm() > 1e-6)) file.Fail("has an invalid pose");
  return Rigid3d(RotationFromQvec(qvec), translation);
}

template <typename File>
ModelObservation ReadObservation(File& file) {
  ModelObservation observation;
  ReadVector(file, "has an invalid key point", &observation.xy);
  // Without a point -1, which is kInvalidPoint3DId as an unsigned number.
  int64_t point3D_id = 0;
  file.Read(&point3D_id);
  observation.point3D_id = static_cast<colmap::point3D_t>(point3D_id);
  return observation;
}

template <typename File>
colmap::Camera ReadCamera(File& file) {
  colmap::camera_t camera_id = 0;
  file.Read(&camera_id);
  const int model_id = file.ReadCameraModel();
  if (!colmap::ExistsCameraModelWithId(model_id)) {
    file.Fail("has a camera model that COLMAP 3.8 lacks");
  }
  uint64_t width = 0;
  uint64_t height = 0;
  file.Read(&width);
  file.Read(&height);
  if (std::min(width, height) == 0 || std::max(width, height) > kMaxImageSize) {
    file.Fail("has a camera with images of " + std::to_string(width) + " x " +
              std::to_string(height));
  }
  colmap::Camera camera;
  camera.SetCameraId(camera_id);
  camera.SetModelId(model_id);
  camera.SetWidth(width);
  camera.SetHeight(height);
  ReadVector(file, "has an invalid camera parameter", &camera.Params());
  return camera;
}

}  // namespace

std::vector<std::string> FindModels(const std::string& path) {
  if (!fs::is_directory(path)) {
    throw std::runtime_error("model folder " + path + " does not exist");
  }
  if (FindFile(path, "images")) return {path};
  std::vector<std::string> folders;
  for (const fs::directory_entry& entry : fs::directory_iterator(path)) {
    const bool is_hidden = entry.path().filename().string().front() == '.';
    if (!is_hidden && entry.is_directory() &&
        FindFile(entry.path(), "images")) {
      folders.push_back(entry.path().string());
    }
  }
  if (folders.empty()) {
    throw std::runtime_error(
        path +
        " holds no model: no images.bin or images.txt in it or in a "
        "sub-folder");
  }
  std::sort(folders.begin(), folders.end());
  return folders;
}

std::string FindLargestModel(const std::string& path) {
  const std::vector<std::string> folders = FindModels(path);
  if (folders.size() == 1) return folders.front();
  std::vector<size_t> num_images;
  for (const std::string& folder : folders) {
    num_images.push_back(ReadModelImages(folder).size());
  }
  const auto largest = std::max_element(num_images.begin(), num_images.end());
  return folders[largest - num_images.begin()];
}

void VisitModelImages(
    const std::string& folder,
    const std::function<void(const ModelImageRecord&)>& visit) {
  ReadFile(folder, "images", [&](auto& file) {
    std::set<std::string> names;
    while (file.NextRecord(kMinImageSize)) {
      ModelImageRecord record;
      ModelImage& image = record.image;
      file.Read(&record.image_id);
      image.cam_from_world = ReadPose(file);
      file.Read(&image.camera_id);
      record.name = file.ReadName();
      if (record.name.empty()) file.Fail("has an image without name");
      if (!names.insert(record.name).second) {
        file.Fail("has image " + record.name + " twice");
      }
      file.BeginObservations();
      while (file.NextObservation()) {
        image.observations.push_back(ReadObservation(file));
      }
      visit(record);
    }
  });
}

std::map<std::string, ModelImage> ReadModelImages(const std::string& folder) {
  std::map<std::string, ModelImage> images;
  VisitModelImages(folder, [&](const ModelImageRecord& record) {
    ModelImage& image = images[record.name];
    image = record.image;
    auto& observations = image.observations;
    observations.erase(std::remove_if(observations.begin(),
                                      observations.end(),
                                      [](const ModelObservation& observation) {
                                        return observation.point3D_id ==
                                               colmap::kInvalidPoint3DId;
                                      }),
                       observations.end());
    observations.shrink_to_fit();
  });
  return images;
}

std::map<colmap::camera_t, colmap::Camera> ReadModelCameras(
    const std::string& folder) {
  std::map<colmap::camera_t, colmap::Camera> cameras;
  ReadFile(folder, "cameras", [&cameras](auto& file) {
    while (file.NextRecord(kMinCameraSize)) {
      const colmap::Camera camera = ReadCamera(file);
      cameras[camera.CameraId()] = camera;
    }
  });
  return cameras;
}

std::vector<ModelPoint> ReadModelPoints(const std::string& folder) {
  std::vector<ModelPoint> points;
  ReadFile(folder, "points3D", [&points](auto& file) {
    while (file.NextRecord(kMinPointSize)) {
      ModelPoint point;
      file.Read(&point.point3D_id);
      ReadVector(file, "has an invalid point", &point.xyz);
      for (uint8_t& value : point.color) file.ReadColor(&value);
      point.track_length = file.SkipErrorAndTrack();
      points.push_back(point);
    }
  });
  return points;
}

}  // namespace dgsfm
