#include "colmap_ext/database/scene_database.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/colmap_schema.h"
#include "colmap_ext/database/keypoint_selection.h"
#include "colmap_ext/database/match_reader.h"

#include <colmap/base/camera_models.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <unordered_set>

namespace dgsfm {

static_assert(std::is_same_v<std::vector<Eigen::Quaterniond>::allocator_type,
                             std::allocator<Eigen::Quaterniond>>,
              "COLMAP must have patches/colmap-3.8/0004 in it: its own "
              "std::vector is not that of files without its headers");

namespace {

// Beyond these numbers overflow what is computed of them, and no camera is.
constexpr int64_t kMaxImageSize = 1000000;  // [px]
constexpr double kMaxCameraParam = 1e12;
constexpr double kMinFocalLength = 1e-3;   // [px]
constexpr double kMaxCoordinatePx = 1e12;  // of key points

// Names the model, so that users need not look up its number.
std::string CameraModelDescription(int64_t model_id) {
  // Added by COLMAP after 3.8.
  static const std::vector<std::string> kNewerModels = {
      "RAD_TAN_THIN_PRISM_FISHEYE",
      "SIMPLE_DIVISION",
      "DIVISION",
      "SIMPLE_FISHEYE",
      "FISHEYE",
      "EUCM",
      "EQUIRECTANGULAR"};
  constexpr int64_t kFirstId = 11;
  const int64_t num_models = static_cast<int64_t>(kNewerModels.size());
  std::string description = "camera model " + std::to_string(model_id);
  // Compared, not subtracted: a damaged id may be the least number there is.
  if (model_id >= kFirstId && model_id < kFirstId + num_models) {
    description += " (" + kNewerModels[model_id - kFirstId] + ")";
  }
  return description;
}

// Reads a row image_id, rows, cols, data.
std::vector<Eigen::Vector2d> ReadPoints(const SqliteConnection& connection,
                                        const SqliteStatement& row,
                                        const std::string& name) {
  const int64_t num_rows = row.Int(1);
  const int64_t num_cols = row.Int(2);
  const std::vector<float> data = row.Blob<float>(3);
  // COLMAP writes such rows for images in which it finds nothing.
  if (num_rows == 0 && data.empty()) return std::vector<Eigen::Vector2d>();
  // x, y; scale and orientation; or an affine shape behind them.
  if (num_cols != 2 && num_cols != 4 && num_cols != 6) {
    throw connection.Error() << "image " << name << ": key points have "
                             << num_cols << " columns, not 2, 4 or 6";
  }
  if (!IsBlobSize(num_rows, num_cols, data.size())) {
    throw connection.Error()
        << "image " << name << ": " << num_rows << " x " << num_cols
        << " key point values announced, " << data.size() << " stored";
  }
  std::vector<Eigen::Vector2d> points;
  points.reserve(num_rows);
  for (int64_t i = 0; i < num_rows; ++i) {
    points.emplace_back(data[num_cols * i], data[num_cols * i + 1]);
    if (!(points.back().array().abs() <= kMaxCoordinatePx).all()) {
      throw connection.Error() << "image " << name << ": position of key point "
                               << i << " is not finite or too far away";
    }
  }
  return points;
}

// Reads the tables in an order in which each can be checked against the ones
// before.
class SceneReader {
 public:
  // At most about max_num_keypoints matched key points an image.
  explicit SceneReader(
      const SqliteConnection& connection,
      size_t max_num_keypoints = std::numeric_limits<size_t>::max(),
      const std::optional<ImageNames>& names = std::nullopt)
      : connection_(connection),
        max_num_keypoints_(max_num_keypoints),
        selected_(names) {}

  Scene Read(SceneContent content) {
    // Another program may write between two of the queries.
    const SqliteTransaction snapshot(connection_,
                                     SqliteTransaction::Kind::READ);
    CheckIsColmapDatabase(connection_);
    ReadCameras();
    ReadImages();
    if (content >= SceneContent::PAIRS) {
      scene_.kept_keypoints =
          SelectKeypoints(connection_, scene_, max_num_keypoints_);
    }
    if (content != SceneContent::IMAGES) ReadKeypoints();
    if (content >= SceneContent::PAIRS) ReadPairs(content);
    return std::move(scene_);
  }

 private:
  void ReadPairs(SceneContent content) {
    MatchReader reader(connection_, scene_);
    for (const MatchReader::PairSize& pair : reader.ListPairs()) {
      colmap::FeatureMatches matches;
      if (content == SceneContent::MATCHES) {
        matches = reader.Read(pair.pair_id);
        RestrictMatches(scene_.kept_keypoints, pair.pair_id, &matches);
      }
      scene_.matches.emplace_hint(
          scene_.matches.end(), pair.pair_id, std::move(matches));
    }
  }

  void ReadCameras() {
    SqliteStatement select(connection_,
                           "SELECT camera_id, model, width, height, params, "
                           "prior_focal_length FROM cameras");
    while (select.Step()) {
      const colmap::Camera camera = ReadCamera(select);
      CheckIsNew(scene_.cameras.emplace(camera.CameraId(), camera).second,
                 "cameras have the id",
                 camera.CameraId());
    }
  }

  // COLMAP's tables have unique ids, but copies of them made by CREATE TABLE AS
  // have not, nor do damaged files.
  void CheckIsNew(bool is_new, const std::string& problem, int64_t id) const {
    if (!is_new) throw connection_.Error() << "two " << problem << " " << id;
  }

  colmap::Camera ReadCamera(const SqliteStatement& row) const {
    const int64_t camera_id = row.Int(0);
    if (camera_id < 0 || camera_id >= colmap::kInvalidCameraId) {
      throw connection_.Error()
          << "camera id " << camera_id << " is out of range";
    }
    const int64_t model_id = row.Int(1);
    if (model_id < std::numeric_limits<int>::min() ||
        model_id > std::numeric_limits<int>::max() ||
        !colmap::ExistsCameraModelWithId(static_cast<int>(model_id))) {
      throw connection_.Error()
          << "camera " << camera_id << ": " << CameraModelDescription(model_id)
          << " is not supported; use one of COLMAP 3.8, e.g. SIMPLE_RADIAL";
    }
    const int64_t width = row.Int(2);
    const int64_t height = row.Int(3);
    if (width <= 0 || height <= 0 || std::max(width, height) > kMaxImageSize) {
      throw connection_.Error() << "camera " << camera_id << ": image size "
                                << width << " x " << height;
    }
    colmap::Camera camera;
    camera.SetCameraId(static_cast<colmap::camera_t>(camera_id));
    camera.SetModelId(static_cast<int>(model_id));
    camera.SetWidth(static_cast<size_t>(width));
    camera.SetHeight(static_cast<size_t>(height));
    camera.SetParams(row.Blob<double>(4));
    camera.SetPriorFocalLength(row.Int(5) != 0);
    CheckParams(camera);
    return camera;
  }

  // COLMAP itself aborts on a wrong number of parameters.
  void CheckParams(const colmap::Camera& camera) const {
    if (!camera.VerifyParams()) {
      throw connection_.Error()
          << "camera " << camera.CameraId() << ": " << camera.NumParams()
          << " parameters, but model " << camera.ModelName() << " has "
          << camera.ParamsInfo();
    }
    for (const double param : camera.Params()) {
      if (!(std::abs(param) <= kMaxCameraParam)) {
        throw connection_.Error()
            << "camera " << camera.CameraId() << ": parameter " << param
            << " is not finite or too large";
      }
    }
    for (const size_t idx : camera.FocalLengthIdxs()) {
      if (camera.Params(idx) < kMinFocalLength) {
        throw connection_.Error()
            << "camera " << camera.CameraId() << ": focal length "
            << camera.Params(idx) << " is not positive or too small";
      }
    }
  }

  // What is written in lines, or by programs in C, would break at these.
  void CheckName(int64_t image_id, const std::string& name) {
    if (name.empty() ||
        name.find_first_of(std::string("\0\n\r", 3)) != std::string::npos) {
      throw connection_.Error() << "image " << image_id
                                << ": its name is empty or has a NUL or a "
                                   "line break";
    }
    if (!names_.insert(name).second) {
      throw connection_.Error() << "two images have the name " << name;
    }
  }

  void CheckSelection() const {
    if (!selected_) return;
    for (const std::string& name : *selected_) {
      if (names_.count(name) == 0) {
        throw connection_.Error()
            << "has no image " << name << ", which the list of images names";
      }
    }
  }

  void ReadImages() {
    SqliteStatement select(connection_,
                           "SELECT image_id, name, camera_id FROM images");
    while (select.Step()) {
      const auto [image_id, name, camera_id] =
          select.Columns<int64_t, std::string, int64_t>();
      // Before anything else, as all other messages contain the name.
      CheckName(image_id, name);
      if (image_id < 0 || image_id >= static_cast<int64_t>(kMaxNumImages)) {
        throw connection_.Error()
            << "image " << name << ": id " << image_id << " is out of range";
      }
      if (camera_id < 0 || camera_id >= colmap::kInvalidCameraId ||
          scene_.cameras.count(static_cast<colmap::camera_t>(camera_id)) == 0) {
        throw connection_.Error() << "image " << name << ": its camera "
                                  << camera_id << " does not exist";
      }
      colmap::Image image;
      image.SetImageId(static_cast<colmap::image_t>(image_id));
      image.SetName(name);
      image.SetCameraId(static_cast<colmap::camera_t>(camera_id));
      if (selected_ && selected_->count(name) == 0) continue;
      CheckIsNew(scene_.images.emplace(image.ImageId(), image).second,
                 "images have the id",
                 image.ImageId());
    }
    CheckSelection();
    if (scene_.images.empty()) {
      throw connection_.Error() << "has no images; run feature_extractor first";
    }
  }

  void ReadKeypoints() {
    SqliteStatement select(connection_,
                           "SELECT image_id, rows, cols, data "
                           "FROM keypoints JOIN images USING (image_id)");
    std::unordered_set<colmap::image_t> has_keypoints;
    while (select.Step()) {
      const auto found =
          scene_.images.find(static_cast<colmap::image_t>(select.Int(0)));
      if (found == scene_.images.end()) continue;
      colmap::Image& image = found->second;
      if (!has_keypoints.insert(image.ImageId()).second) {
        throw connection_.Error()
            << "image " << image.Name() << " has two rows of key points";
      }
      image.SetPoints2D(
          RestrictToKept(scene_.kept_keypoints,
                         image.ImageId(),
                         ReadPoints(connection_, select, image.Name())));
    }
  }

  const SqliteConnection& connection_;
  const size_t max_num_keypoints_;
  const std::optional<ImageNames> selected_;
  std::unordered_set<std::string> names_;
  Scene scene_;
};

}  // namespace

Scene ReadScene(const std::string& database_path,
                SceneContent content,
                SqliteConnection::Mode mode) {
  const SqliteConnection connection(database_path, mode);
  return SceneReader(connection).Read(content);
}

Scene ReadPartOfScene(const std::string& database_path,
                      int max_num_keypoints,
                      const std::optional<ImageNames>& names,
                      SceneContent content) {
  DGSFM_CHECK(max_num_keypoints >= 0) << max_num_keypoints;
  const SqliteConnection connection(database_path,
                                    SqliteConnection::Mode::READ_ONLY);
  return SceneReader(connection,
                     max_num_keypoints == 0
                         ? std::numeric_limits<size_t>::max()
                         : static_cast<size_t>(max_num_keypoints),
                     names)
      .Read(content);
}

std::vector<Eigen::Vector2d> ReadKeypoints(const SqliteConnection& connection,
                                           const colmap::Image& image) {
  SqliteStatement select(
      connection,
      "SELECT image_id, rows, cols, data FROM keypoints WHERE image_id = ?",
      image.ImageId());
  if (!select.Step()) return std::vector<Eigen::Vector2d>();
  return ReadPoints(connection, select, image.Name());
}

}  // namespace dgsfm
