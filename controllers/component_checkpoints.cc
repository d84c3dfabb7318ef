#include "controllers/component_checkpoints.h"

#include "colmap_ext/fnv_hash.h"
#include "colmap_ext/model/model_writer.h"
#include "colmap_ext/output_file.h"
#include "controllers/output_folder.h"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include <glog/logging.h>
#include <nlohmann/json.hpp>

namespace nlohmann {

template <>
struct adl_serializer<Eigen::Vector3d> {
  static void to_json(json& json, const Eigen::Vector3d& vector) {
    json = {vector.x(), vector.y(), vector.z()};
  }
  static void from_json(const json& json, Eigen::Vector3d& vector) {
    for (int i = 0; i < 3; ++i) vector[i] = json.at(i).get<double>();
  }
};

}  // namespace nlohmann

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

using Json = nlohmann::json;

// Readers of models take no folder for one whose name begins with a dot.
constexpr char kRoot[] = ".dgsfm_checkpoints";
constexpr char kPartial[] = "partial";
// What a model in COLMAP's format lacks of the component.
constexpr char kRestFile[] = "component.cbor";

std::string HexText(uint64_t number) {
  char text[17];
  std::snprintf(
      text, sizeof(text), "%016llx", static_cast<unsigned long long>(number));
  return text;
}

}  // namespace

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PairVerdict, stage, status)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PairOutcome,
                                   status,
                                   verdicts,
                                   degeneracies,
                                   has_scale,
                                   num_matches,
                                   num_inliers,
                                   has_inliers)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(
    StageReport, stage, figures, seconds, cpu_seconds, peak_memory_mb)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(MappingLog, stages, warnings)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(
    CameraResult, params, prior_stddevs, stddevs, group)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ModelGeoreference,
                                   is_georeferenced,
                                   scale_source,
                                   num_positions,
                                   num_inliers,
                                   scale_of_depth,
                                   scale_of_rigs,
                                   log_scale_stddev_of_depth,
                                   log_scale_stddev_of_positions,
                                   rotation_stddev_deg,
                                   spread,
                                   median_horizontal_error_m,
                                   median_vertical_error_m,
                                   part_sizes,
                                   errors)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PoseMetrics,
                                   num_images,
                                   num_registered,
                                   relative_errors_deg,
                                   median_rotation_error_deg,
                                   median_translation_error_deg,
                                   truth_from_model_scale,
                                   rms_center_error,
                                   max_center_error)

namespace {

using Numbers = std::vector<double>;

template <typename Vector>
Numbers NumbersOf(const Vector& vector) {
  return Numbers(vector.data(), vector.data() + vector.size());
}

// What COLMAP's files of a model lack: the model itself is not to differ in a
// bit, and readers normalise rotations.
Json ModelRestToJson(const colmap::Reconstruction& model) {
  std::vector<colmap::camera_t> prior_cameras;
  for (const auto& [camera_id, camera] : model.Cameras()) {
    if (camera.HasPriorFocalLength()) prior_cameras.push_back(camera_id);
  }
  std::map<colmap::image_t, Numbers> qvecs;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    qvecs.emplace(image_id, NumbersOf(model.Image(image_id).Qvec()));
  }
  return {{"prior_cameras", prior_cameras}, {"qvecs", qvecs}};
}

std::unique_ptr<colmap::Reconstruction> ReadModel(const fs::path& folder,
                                                  const Json& rest) {
  // COLMAP's reader ends the program where a file is cut.
  for (const char* file : kModelFiles) {
    if (fs::file_size(folder / file) != rest.at("file_sizes").at(file)) {
      throw std::runtime_error((folder / file).string() + " is damaged");
    }
  }
  auto model = std::make_unique<colmap::Reconstruction>();
  model->ReadBinary(folder.string());
  for (const auto& [camera_id, camera] : model->Cameras()) {
    model->Camera(camera_id).SetPriorFocalLength(false);
  }
  for (const colmap::camera_t camera_id : rest.at("prior_cameras")) {
    model->Camera(camera_id).SetPriorFocalLength(true);
  }
  const auto qvecs = rest.at("qvecs").get<std::map<colmap::image_t, Numbers>>();
  for (const auto& [image_id, qvec] : qvecs) {
    model->Image(image_id).SetQvec(
        {qvec.at(0), qvec.at(1), qvec.at(2), qvec.at(3)});
  }
  return model;
}

void WriteComponent(const MappedComponent& component, const fs::path& folder) {
  const ComponentResult& result = component.result;
  Json json = {{"other_parts", component.other_parts},
               {"pairs", component.pairs},
               {"log", component.log},
               {"cameras", result.cameras},
               {"unregistered_images", result.unregistered_images},
               {"depth_scales", result.depth_scales},
               {"georeference", result.georeference},
               {"refined_sensors", result.refined_sensors}};
  if (result.repeatability) json["repeatability"] = *result.repeatability;
  if (result.model) {
    WriteModel(*result.model, folder.string());
    json["model"] = ModelRestToJson(*result.model);
    for (const char* file : kModelFiles) {
      json["model"]["file_sizes"][file] = fs::file_size(folder / file);
    }
  }
  const std::vector<uint8_t> bytes = Json::to_cbor(json);
  WriteFile((folder / kRestFile).string(),
            {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

MappedComponent ReadComponent(const fs::path& folder) {
  std::ifstream file(folder / kRestFile, std::ios::binary);
  const Json json = Json::from_cbor(file);
  MappedComponent component;
  json.at("other_parts").get_to(component.other_parts);
  json.at("pairs").get_to(component.pairs);
  json.at("log").get_to(component.log);
  ComponentResult& result = component.result;
  json.at("cameras").get_to(result.cameras);
  json.at("unregistered_images").get_to(result.unregistered_images);
  json.at("depth_scales").get_to(result.depth_scales);
  json.at("georeference").get_to(result.georeference);
  json.at("refined_sensors").get_to(result.refined_sensors);
  if (json.contains("repeatability")) {
    result.repeatability = json.at("repeatability").get<PoseMetrics>();
  }
  if (json.contains("model")) result.model = ReadModel(folder, json["model"]);
  return component;
}

}  // namespace

ComponentCheckpoints::ComponentCheckpoints(const std::string& output_path,
                                           uint64_t key)
    : root_((fs::path(output_path) / kRoot).string()),
      folder_((fs::path(root_) / HexText(key)).string()) {
  std::error_code ignored;
  for (const fs::directory_entry& entry :
       fs::directory_iterator(root_, ignored)) {
    if (entry.path() != folder_) fs::remove_all(entry.path(), ignored);
  }
}

std::optional<MappedComponent> ComponentCheckpoints::Find(
    const ImageIds& image_ids) {
  const std::string folder = FolderOf(image_ids);
  if (!fs::exists(folder)) return std::nullopt;
  try {
    return ReadComponent(folder);
  } catch (const std::exception& error) {
    LOG(WARNING) << "A component is mapped again, as " << folder
                 << " cannot be read: " << error.what();
    return std::nullopt;
  }
}

void ComponentCheckpoints::Keep(const ImageIds& image_ids,
                                const MappedComponent& component) {
  const fs::path partial = fs::path(folder_) / kPartial;
  try {
    fs::remove_all(partial);
    CreateOutputFolder(partial.string());
    WriteComponent(component, partial);
    const std::string folder = FolderOf(image_ids);
    fs::remove_all(folder);
    ReplaceFolder(partial.string(), folder);
  } catch (const std::exception& error) {
    LOG(WARNING) << "A run that is broken off has to map a component again, as "
                    "it cannot be stored: "
                 << error.what();
    std::error_code ignored;
    fs::remove_all(partial, ignored);
  }
}

void ComponentCheckpoints::Remove() {
  std::error_code ignored;
  fs::remove_all(root_, ignored);
}

std::string ComponentCheckpoints::FolderOf(const ImageIds& image_ids) const {
  FnvHash hash;
  hash.AddAll(image_ids);
  return (fs::path(folder_) / HexText(hash.Value())).string();
}

}  // namespace dgsfm
