#include "colmap_ext/database/rig_database.h"

#include "colmap_ext/database/sqlite.h"

#include <fstream>
#include <set>
#include <stdexcept>
#include <utility>

#include <nlohmann/json.hpp>

namespace dgsfm {

namespace {

using Json = nlohmann::json;

// The pose that w, x, y, z and a translation give; nothing for other numbers of
// values, and for values from which none follows.
std::optional<Rigid3d> PoseOf(const std::vector<double>& values) {
  if (values.size() != 7) return std::nullopt;
  const Eigen::Vector4d qvec(values[0], values[1], values[2], values[3]);
  const Eigen::Vector3d translation(values[4], values[5], values[6]);
  // Beyond these numbers overflow what is computed of them.
  if (!(qvec.norm() > 1e-3) || !(qvec.norm() < 1e12) ||
      !(translation.norm() < 1e12)) {
    return std::nullopt;
  }
  return Rigid3d(RotationFromQvec(qvec), translation);
}

// Leaves rigs and frames of one camera or image out.
RigScene WithSeveralCameras(RigScene rigs) {
  RigScene kept;
  for (auto& [frame_id, frame] : rigs.frames) {
    if (frame.images.size() < 2) continue;
    kept.rigs[frame.rig_id] = rigs.rigs.at(frame.rig_id);
    kept.frames[frame_id] = std::move(frame);
  }
  return kept;
}

class RigReader {
 public:
  RigReader(const std::string& database_path, const Scene& scene)
      : connection_(database_path, SqliteConnection::Mode::READ_ONLY),
        scene_(scene) {}

  RigScene Read() {
    if (!connection_.HasTable("rigs") || !connection_.HasTable("rig_sensors") ||
        !connection_.HasTable("frames") ||
        !connection_.HasTable("frame_data")) {
      return {};
    }
    ReadReferences();
    ReadSensors();
    ReadFrames();
    return WithSeveralCameras(std::move(rigs_));
  }

 private:
  [[noreturn]] void Fail(rig_t rig_id, const std::string& what) const {
    throw connection_.Error() << "rig " << rig_id << ": " << what;
  }

  void AddCamera(rig_t rig_id,
                 int64_t camera_id,
                 const std::optional<Rigid3d>& cam_from_rig) {
    const std::string name = "camera " + std::to_string(camera_id);
    const auto id = colmap::camera_t(camera_id);
    if (id != camera_id || scene_.cameras.count(id) == 0) {
      Fail(rig_id, name + " does not exist");
    }
    if (!rig_of_camera_.emplace(id, rig_id).second) {
      Fail(rig_id, name + " is in two rigs, or twice in one");
    }
    rigs_.rigs[rig_id].cam_from_rig[id] = cam_from_rig;
  }

  // Rigs of one camera are no rigs here: what they name may be gone.
  void ReadReferences() {
    SqliteStatement select(
        connection_,
        "SELECT rig_id, ref_sensor_id FROM rigs WHERE ref_sensor_type = ?1 "
        "AND rig_id IN (SELECT rig_id FROM rig_sensors WHERE sensor_type = ?1) "
        "ORDER BY rig_id");
    select.Bind(kCameraSensorType);
    while (select.Step()) {
      const auto rig_id = rig_t(select.Int(0));
      AddCamera(rig_id, select.Int(1), Rigid3d());
      rigs_.rigs[rig_id].ref_camera_id = colmap::camera_t(select.Int(1));
    }
  }

  void ReadSensors() {
    SqliteStatement select(
        connection_,
        "SELECT rig_id, sensor_id, sensor_from_rig FROM rig_sensors "
        "WHERE sensor_type = ? ORDER BY rig_id, sensor_id");
    select.Bind(kCameraSensorType);
    while (select.Step()) {
      const auto rig_id = rig_t(select.Int(0));
      if (rigs_.rigs.count(rig_id) == 0) {
        Fail(rig_id, "the reference sensor is not a camera");
      }
      std::optional<Rigid3d> cam_from_rig;
      if (!select.IsNull(2)) {
        cam_from_rig = PoseOf(select.Blob<double>(2));
        if (!cam_from_rig) {
          Fail(rig_id,
               "sensor_from_rig of camera " + std::to_string(select.Int(1)) +
                   " is not a pose");
        }
      }
      AddCamera(rig_id, select.Int(1), cam_from_rig);
    }
  }

  // Frames keep the images that the database still has.
  void ReadFrames() {
    SqliteStatement select(
        connection_,
        "SELECT frames.frame_id, rig_id, data_id, sensor_id FROM frames "
        "JOIN frame_data ON frames.frame_id = frame_data.frame_id "
        "WHERE sensor_type = ?1 "
        "AND rig_id IN (SELECT rig_id FROM rig_sensors WHERE sensor_type = ?1) "
        "ORDER BY frames.frame_id, data_id");
    select.Bind(kCameraSensorType);
    std::set<colmap::image_t> seen;
    while (select.Step()) {
      const auto frame_id = frame_t(select.Int(0));
      const auto rig_id = rig_t(select.Int(1));
      const auto image_id = colmap::image_t(select.Int(2));
      const auto camera_id = colmap::camera_t(select.Int(3));
      const std::string where = "frame " + std::to_string(frame_id) +
                                ", image " + std::to_string(image_id);
      const auto image = scene_.images.find(image_id);
      if (image_id != select.Int(2) || image == scene_.images.end()) continue;
      const auto rig = rigs_.rigs.find(rig_id);
      if (rig == rigs_.rigs.end() ||
          rig->second.cam_from_rig.count(camera_id) == 0 ||
          image->second.CameraId() != camera_id) {
        Fail(rig_id, where + ": its camera is not one of the rig");
      }
      Frame& frame = rigs_.frames[frame_id];
      frame.rig_id = rig_id;
      if (!seen.insert(image_id).second ||
          !frame.images.emplace(camera_id, image_id).second) {
        Fail(rig_id, where + ": is in two frames, or its camera twice in one");
      }
    }
  }

  const SqliteConnection connection_;
  const Scene& scene_;
  RigScene rigs_;
  std::map<colmap::camera_t, rig_t> rig_of_camera_;
};

struct PrefixedCamera {
  std::string image_prefix;
  bool is_reference = false;
  std::optional<Rigid3d> cam_from_rig;
};

// Throws for an object that lacks the required key, or has one that is none of
// `keys`, which may be misspelt.
void CheckKeys(const Json& json,
               const std::string& what,
               const std::string& required,
               std::set<std::string> keys) {
  keys.insert(required);
  if (!json.is_object()) {
    throw std::runtime_error(what + " has to be an object {...}, not " +
                             json.dump());
  }
  for (const auto& [key, value] : json.items()) {
    if (keys.count(key) > 0) continue;
    std::string known;
    for (const std::string& name : keys) {
      known += (known.empty() ? "" : ", ") + name;
    }
    throw std::runtime_error(what + " has the unknown key " + key +
                             ", not one of " + known + ": " + json.dump());
  }
  if (!json.contains(required)) {
    throw std::runtime_error(what + " has no " + required + ": " + json.dump());
  }
}

// Intrinsics of the file would have to be in the database before pairs are
// verified.
void CheckHasNoIntrinsics(const Json& json, const std::string& image_prefix) {
  for (const char* key : {"camera_model_name", "camera_params"}) {
    if (!json.contains(key)) continue;
    throw std::runtime_error(
        "prefix " + image_prefix + " has " + key +
        ", which is not read here: write it to the database by COLMAP's "
        "rig_configurator (3.12 or later) and leave --rig_config_path out, or "
        "remove it from the file if the cameras of the database are right");
  }
}

PrefixedCamera ParseCamera(const Json& json) {
  PrefixedCamera camera;
  CheckKeys(json,
            "a camera",
            "image_prefix",
            {"cam_from_rig_rotation",
             "cam_from_rig_translation",
             "camera_model_name",
             "camera_params",
             "ref_sensor"});
  camera.image_prefix = json.at("image_prefix").get<std::string>();
  CheckHasNoIntrinsics(json, camera.image_prefix);
  camera.is_reference = json.value("ref_sensor", false);
  const bool has_rotation = json.contains("cam_from_rig_rotation");
  if (has_rotation != json.contains("cam_from_rig_translation")) {
    throw std::runtime_error("prefix " + camera.image_prefix +
                             " has one of cam_from_rig_rotation and "
                             "cam_from_rig_translation only");
  }
  if (camera.is_reference) {
    camera.cam_from_rig = Rigid3d();
  } else if (has_rotation) {
    auto values = json.at("cam_from_rig_rotation").get<std::vector<double>>();
    for (const double value :
         json.at("cam_from_rig_translation").get<std::vector<double>>()) {
      values.push_back(value);
    }
    camera.cam_from_rig = PoseOf(values);
    if (!camera.cam_from_rig) {
      throw std::runtime_error("prefix " + camera.image_prefix +
                               ": rotation (w, x, y, z) and translation are "
                               "not a pose");
    }
  }
  return camera;
}

// The camera of all images with a prefix; their names without it.
colmap::camera_t CameraOfPrefix(
    const std::string& prefix,
    const Scene& scene,
    std::map<std::string, colmap::image_t>* suffixes) {
  colmap::camera_t camera_id = colmap::kInvalidCameraId;
  for (const auto& [image_id, image] : scene.images) {
    if (image.Name().compare(0, prefix.size(), prefix) != 0) continue;
    if (!suffixes->empty() && image.CameraId() != camera_id) {
      throw std::runtime_error(
          "images with prefix " + prefix + " have several cameras, such as " +
          image.Name() +
          ": extract features with --ImageReader.single_camera_per_folder 1");
    }
    camera_id = image.CameraId();
    (*suffixes)[image.Name().substr(prefix.size())] = image_id;
  }
  if (suffixes->empty()) {
    throw std::runtime_error("no image has the prefix " + prefix);
  }
  return camera_id;
}

void AddConfiguredRig(const Json& json,
                      const Scene& scene,
                      std::set<colmap::camera_t>* used,
                      RigScene* rigs) {
  const rig_t rig_id = rig_t(rigs->rigs.size()) + 1;
  Rig& rig = rigs->rigs[rig_id];
  std::map<std::string, Frame> frames;
  CheckKeys(json, "a rig", "cameras", {});
  for (const Json& camera_json : json.at("cameras")) {
    const PrefixedCamera camera = ParseCamera(camera_json);
    std::map<std::string, colmap::image_t> suffixes;
    const colmap::camera_t camera_id =
        CameraOfPrefix(camera.image_prefix, scene, &suffixes);
    if (!used->insert(camera_id).second) {
      throw std::runtime_error("camera " + std::to_string(camera_id) +
                               " has two prefixes, one of them " +
                               camera.image_prefix);
    }
    if (camera.is_reference) {
      if (rig.ref_camera_id != colmap::kInvalidCameraId) {
        throw std::runtime_error(
            "a rig has two reference sensors, one of them "
            "with prefix " +
            camera.image_prefix);
      }
      rig.ref_camera_id = camera_id;
    }
    rig.cam_from_rig[camera_id] = camera.cam_from_rig;
    for (const auto& [suffix, image_id] : suffixes) {
      frames[suffix].rig_id = rig_id;
      frames[suffix].images[camera_id] = image_id;
    }
  }
  if (rig.ref_camera_id == colmap::kInvalidCameraId) {
    throw std::runtime_error("a rig has no camera with \"ref_sensor\": true");
  }
  for (auto& [suffix, frame] : frames) {
    rigs->frames[frame_t(rigs->frames.size()) + 1] = std::move(frame);
  }
}

}  // namespace

RigScene ReadRigs(const std::string& database_path, const Scene& scene) {
  return RigReader(database_path, scene).Read();
}

RigScene ReadRigConfig(const std::string& path, const Scene& scene) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path + ": cannot be read");
  RigScene rigs;
  std::set<colmap::camera_t> used;
  try {
    const Json config = Json::parse(file);
    if (!config.is_array() || config.empty()) {
      throw std::runtime_error(
          "has to be a list of rigs, [{\"cameras\": [...]}, ...]; without "
          "--rig_config_path the rigs of the database count");
    }
    for (const Json& rig : config) {
      AddConfiguredRig(rig, scene, &used, &rigs);
    }
  } catch (const std::exception& error) {
    throw std::runtime_error(path + ": " + error.what());
  }
  return WithSeveralCameras(std::move(rigs));
}

RigScene ReadRigs(const std::string& database_path,
                  const std::string& rig_config_path,
                  const Scene& scene) {
  return rig_config_path.empty() ? ReadRigs(database_path, scene)
                                 : ReadRigConfig(rig_config_path, scene);
}

}  // namespace dgsfm
