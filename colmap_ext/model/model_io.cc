#include "colmap_ext/model/model_io.h"

#include <colmap/base/camera_models.h>
#include <colmap/util/endian.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <stdexcept>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

constexpr double kMaxNumber = 1e30;
constexpr size_t kMaxImageSize = 1000000;  // [px]

// Reads numbers of a binary file, never beyond its end.
class BinaryFile {
 public:
  explicit BinaryFile(const fs::path& path)
      : path_(path), stream_(path, std::ios::binary) {
    if (!stream_) throw std::runtime_error("cannot read " + path.string());
    num_left_ = fs::file_size(path);
    size_ = num_left_;
  }

  template <typename T>
  T Read() {
    Take(sizeof(T));
    const T value = colmap::ReadBinaryLittleEndian<T>(&stream_);
    if (!stream_) Fail("cannot be read");
    return value;
  }

  // Number of following records that have at least `record_size` bytes each.
  uint64_t ReadCount(size_t record_size) {
    const uint64_t count = Read<uint64_t>();
    if (count > num_left_ / record_size) Fail("is truncated");
    return count;
  }

  std::string ReadString() {
    std::string text;
    while (const char c = Read<char>()) text += c;
    return text;
  }

  void Skip(uint64_t num_bytes) {
    Take(num_bytes);
    stream_.seekg(num_bytes, std::ios::cur);
  }

  [[noreturn]] void Fail(const std::string& problem) const {
    throw std::runtime_error(path_.string() + " " + problem + " (byte " +
                             std::to_string(size_ - num_left_) + " of " +
                             std::to_string(size_) + ")");
  }

 private:
  void Take(uint64_t num_bytes) {
    if (num_bytes > num_left_) Fail("is truncated");
    num_left_ -= num_bytes;
  }

  fs::path path_;
  std::ifstream stream_;
  uint64_t size_ = 0;
  uint64_t num_left_ = 0;
};

// Reads a text file line by line and the numbers of a line.
class TextFile {
 public:
  explicit TextFile(const fs::path& path) : path_(path), stream_(path) {
    if (!stream_) throw std::runtime_error("cannot read " + path.string());
  }

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

  // The next line that is neither empty nor a comment.
  bool NextRecord() {
    while (NextLine()) {
      line_ >> std::ws;
      if (!line_.eof() && line_.peek() != '#') return true;
    }
    return false;
  }

  template <typename T>
  T Read() {
    T value;
    if (!(line_ >> value)) Fail("is malformed");
    return value;
  }

  bool HasMore() {
    line_ >> std::ws;
    return !line_.eof();
  }

  std::string ReadRestOfLine() {
    std::string text;
    std::getline(line_ >> std::ws, text);
    return text;
  }

  [[noreturn]] void Fail(const std::string& problem) const {
    throw std::runtime_error(path_.string() + " " + problem + " (line " +
                             std::to_string(line_number_) + ")");
  }

 private:
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

// Calls read_binary with a BinaryFile or read_text with a TextFile.
template <typename ReadBinary, typename ReadText>
void ReadFile(const std::string& folder,
              const std::string& stem,
              const ReadBinary& read_binary,
              const ReadText& read_text) {
  const std::optional<fs::path> path = FindFile(folder, stem);
  if (!path) {
    throw std::runtime_error(folder + " has neither " + stem + ".bin nor " +
                             stem + ".txt");
  }
  if (path->extension() == ".bin") {
    BinaryFile file(*path);
    read_binary(file);
  } else {
    TextFile file(*path);
    read_text(file);
  }
}

// Finite, also where numbers are squared or become depths of 32 bits.
template <typename Vector>
bool IsSound(const Vector& vector) {
  return (vector.array().abs() <= kMaxNumber).all();
}

// Both forms have the same numbers in the same order.
template <typename File>
Rigid3d ReadPose(File& file) {
  Eigen::Vector4d qvec;
  Eigen::Vector3d translation;
  for (double& value : qvec) value = file.template Read<double>();
  for (double& value : translation) value = file.template Read<double>();
  if (!IsSound(qvec) || !IsSound(translation) || !(qvec.norm() > 1e-6)) {
    file.Fail("has an invalid pose");
  }
  return Rigid3d(RotationFromQvec(qvec), translation);
}

template <typename File>
Eigen::Vector3d ReadXyz(File& file) {
  Eigen::Vector3d xyz;
  for (double& value : xyz) value = file.template Read<double>();
  if (!IsSound(xyz)) file.Fail("has an invalid point");
  return xyz;
}

template <typename File>
ModelObservation ReadObservation(File& file) {
  ModelObservation observation;
  for (double& value : observation.xy) value = file.template Read<double>();
  // Without a point -1, which is kInvalidPoint3DId as an unsigned number.
  observation.point3D_id = file.template Read<int64_t>();
  if (!IsSound(observation.xy)) file.Fail("has an invalid key point");
  return observation;
}

void AddObservation(const ModelObservation& observation, ModelImage* image) {
  if (observation.point3D_id == colmap::kInvalidPoint3DId) return;
  image->observations.push_back(observation);
}

template <typename File>
ModelImage* AddImage(File& file,
                     const std::string& name,
                     const ModelImage& image,
                     std::map<std::string, ModelImage>* images) {
  if (name.empty()) file.Fail("has an image without name");
  const auto [added, is_new] = images->emplace(name, image);
  if (!is_new) file.Fail("has image " + name + " twice");
  return &added->second;
}

template <typename File>
colmap::Camera ReadCamera(File& file, colmap::camera_t id, int model_id) {
  if (!colmap::ExistsCameraModelWithId(model_id)) {
    file.Fail("has a camera model that COLMAP 3.8 lacks");
  }
  colmap::Camera camera;
  camera.SetCameraId(id);
  camera.SetModelId(model_id);
  camera.SetWidth(file.template Read<uint64_t>());
  camera.SetHeight(file.template Read<uint64_t>());
  const auto [min_size, max_size] =
      std::minmax({camera.Width(), camera.Height()});
  if (min_size == 0 || max_size > kMaxImageSize) {
    file.Fail("has a camera with images of " + std::to_string(camera.Width()) +
              " x " + std::to_string(camera.Height()));
  }
  for (double& param : camera.Params()) {
    param = file.template Read<double>();
    if (!(std::abs(param) <= kMaxNumber)) {
      file.Fail("has an invalid camera parameter");
    }
  }
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

std::map<std::string, ModelImage> ReadModelImages(const std::string& folder) {
  std::map<std::string, ModelImage> images;
  const auto read_binary = [&images](BinaryFile& file) {
    // Id, pose, camera id, terminating zero of the name, number of points.
    constexpr size_t kMinImageSize = 4 + 7 * 8 + 4 + 1 + 8;
    constexpr size_t kPointSize = 3 * 8;
    const uint64_t num_images = file.ReadCount(kMinImageSize);
    for (uint64_t i = 0; i < num_images; ++i) {
      file.Read<colmap::image_t>();
      ModelImage image;
      image.cam_from_world = ReadPose(file);
      image.camera_id = file.Read<colmap::camera_t>();
      ModelImage* added = AddImage(file, file.ReadString(), image, &images);
      for (uint64_t left = file.ReadCount(kPointSize); left > 0; --left) {
        AddObservation(ReadObservation(file), added);
      }
    }
  };
  const auto read_text = [&images](TextFile& file) {
    while (file.NextRecord()) {
      file.Read<colmap::image_t>();
      ModelImage image;
      image.cam_from_world = ReadPose(file);
      image.camera_id = file.Read<colmap::camera_t>();
      ModelImage* added = AddImage(file, file.ReadRestOfLine(), image, &images);
      file.NextLine();
      while (file.HasMore()) AddObservation(ReadObservation(file), added);
    }
  };
  ReadFile(folder, "images", read_binary, read_text);
  return images;
}

std::map<colmap::camera_t, colmap::Camera> ReadModelCameras(
    const std::string& folder) {
  std::map<colmap::camera_t, colmap::Camera> cameras;
  const auto read_binary = [&cameras](BinaryFile& file) {
    const uint64_t num_cameras = file.ReadCount(4 + 4 + 8 + 8);
    for (uint64_t i = 0; i < num_cameras; ++i) {
      const auto id = file.Read<colmap::camera_t>();
      cameras[id] = ReadCamera(file, id, file.Read<int>());
    }
  };
  const auto read_text = [&cameras](TextFile& file) {
    while (file.NextRecord()) {
      const auto id = file.Read<colmap::camera_t>();
      const auto model = file.Read<std::string>();
      const bool is_known = colmap::ExistsCameraModelWithName(model);
      cameras[id] = ReadCamera(
          file, id, is_known ? colmap::CameraModelNameToId(model) : -1);
    }
  };
  ReadFile(folder, "cameras", read_binary, read_text);
  return cameras;
}

std::vector<ModelPoint> ReadModelPoints(const std::string& folder) {
  std::vector<ModelPoint> points;
  const auto read_binary = [&points](BinaryFile& file) {
    // Id, position, colour, error, length of the track.
    const uint64_t num_points = file.ReadCount(8 + 3 * 8 + 3 + 8 + 8);
    constexpr size_t kTrackElementSize = 2 * 4;
    points.reserve(num_points);
    for (uint64_t i = 0; i < num_points; ++i) {
      ModelPoint point;
      point.point3D_id = file.Read<colmap::point3D_t>();
      point.xyz = ReadXyz(file);
      for (uint8_t& value : point.color) value = file.Read<uint8_t>();
      file.Read<double>();  // reprojection error
      point.track_length = file.ReadCount(kTrackElementSize);
      file.Skip(kTrackElementSize * point.track_length);
      points.push_back(point);
    }
  };
  const auto read_text = [&points](TextFile& file) {
    while (file.NextRecord()) {
      ModelPoint point;
      point.point3D_id = file.Read<colmap::point3D_t>();
      point.xyz = ReadXyz(file);
      for (uint8_t& value : point.color) {
        value = std::clamp(file.Read<int>(), 0, 255);
      }
      file.Read<std::string>();  // reprojection error
      for (; file.HasMore(); ++point.track_length) {
        file.Read<colmap::image_t>();
        file.Read<colmap::point2D_t>();
      }
      points.push_back(point);
    }
  };
  ReadFile(folder, "points3D", read_binary, read_text);
  return points;
}

}  // namespace dgsfm
