#include "controllers/depth_scene_synthesizer.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/formats/picture_file.h"
#include "colmap_ext/model/model_writer.h"
#include "colmap_ext/output_file.h"
#include "colmap_ext/pose_access.h"
#include "colmap_ext/progress.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "colmap_ext/synthetic/town_scene.h"
#include "controllers/commands/command_options.h"
#include "controllers/commands/commands.h"
#include "controllers/output_folder.h"

#include <filesystem>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <nlohmann/json.hpp>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

// Surface points of the true model per image, as many as sparse models have.
constexpr int kNumPointsPerImage = 300;
// Resolution of the depth maps in databases of observations [px].
constexpr int kDepthCellSize = 16;

// A folder that exists and is empty, or was created.
void CreateEmptyFolder(const std::string& path) {
  CreateOutputFolder(path);
  if (!fs::is_empty(path)) {
    throw std::runtime_error("the output folder '" + path + "' is not empty");
  }
}

void CreateFolder(const fs::path& path) {
  std::error_code error;
  if (!fs::create_directory(path, error)) {
    throw std::runtime_error("cannot create the folder '" + path.string() +
                             "': " + error.message());
  }
}

void WriteTruth(const fs::path& path,
                const colmap::Reconstruction& model,
                const std::map<std::string, double>& depth_scales) {
  std::ostringstream text;
  // Enough digits to read the same double back.
  text.precision(17);
  for (const auto& [name, scale] : depth_scales) {
    text << name << " " << scale << "\n";
  }
  WriteFile((path / "depth_scales.txt").string(), text.str());
  WriteModel(model, path.string());
}

void WriteObservations(const SyntheticScene& scene, const fs::path& path) {
  WriteSyntheticDatabase(scene, path.string());
  DepthDatabase database(path.string(), DepthDatabase::Mode::READ_WRITE);
  database.BeginTransaction();
  for (const auto& [image_id, depths] : KeypointDepthsFromSynthetic(scene)) {
    database.WriteDepthMap(
        image_id,
        DepthMapFromSynthetic(scene, image_id, kDepthCellSize),
        depths);
  }
  database.CommitTransaction();
}

void WriteImagesAndDepth(const DepthSceneSynthesizerOptions& options) {
  const SyntheticSceneOptions& scene = options.scene;
  const fs::path output_path(options.output_path);
  for (const char* name : {"images", "depth", "gt"}) {
    CreateFolder(output_path / name);
  }
  const RenderScene town = CreateTown(scene.random_seed);
  colmap::Reconstruction model = CreateTownModel(scene);
  const std::vector<double> scales = SynthesizeDepthScales(
      scene.depth_noise.log_scale_stddev, scene.num_images, scene.random_seed);
  std::map<std::string, double> depth_scales;
  Progress progress("Rendering images", scene.num_images);
  for (int i = 0; i < scene.num_images; ++i) {
    const colmap::Image& image = model.Image(i + 1);
    RenderedImage rendered = RenderImage(town,
                                         model.Camera(image.CameraId()),
                                         CamFromWorld(image),
                                         options.num_threads);
    const fs::path image_path = output_path / "images" / image.Name();
    WritePicture(image_path.string(), rendered.bitmap);
    AddDepthErrors(scene.depth_noise,
                   model.Camera(image.CameraId()),
                   scales[i],
                   scene.random_seed,
                   image.ImageId(),
                   &rendered.depth_map);
    WriteDepthNpy((output_path / "depth" / (image.Name() + ".npy")).string(),
                  rendered.depth_map,
                  NpyPrecision::HALF);
    depth_scales[image.Name()] = scales[i];
    progress.Step();
  }
  AddSurfacePoints(town, kNumPointsPerImage, &model);
  WriteTruth(output_path / "gt", model, depth_scales);
}

void WriteOrigin(const fs::path& path) {
  const GeodeticPosition origin = SyntheticFrame().Origin();
  std::ostringstream text;
  text << origin.latitude_deg << " " << origin.longitude_deg << " "
       << origin.altitude_m << "\n";
  WriteFile(path.string(), text.str());
}

// COLMAP's rig_config.json.
void WriteRigConfig(SyntheticRig rig, const fs::path& path) {
  const std::vector<Rigid3d> cams_from_rig = CamsFromRig(rig);
  nlohmann::ordered_json cameras;
  for (size_t i = 0; i < cams_from_rig.size(); ++i) {
    nlohmann::ordered_json& camera = cameras.emplace_back();
    camera["image_prefix"] = "cam" + std::to_string(i) + "/";
    if (i == 0) {
      camera["ref_sensor"] = true;
      continue;
    }
    const Eigen::Quaterniond& rotation = cams_from_rig[i].rotation;
    const Eigen::Vector3d& translation = cams_from_rig[i].translation;
    camera["cam_from_rig_rotation"] = {
        rotation.w(), rotation.x(), rotation.y(), rotation.z()};
    camera["cam_from_rig_translation"] = {
        translation.x(), translation.y(), translation.z()};
  }
  nlohmann::ordered_json config = nlohmann::ordered_json::array();
  config.push_back({{"cameras", std::move(cameras)}});
  WriteFile(path.string(), JsonText(config, 2) + "\n");
}

void WriteDatabase(const DepthSceneSynthesizerOptions& options) {
  const fs::path output_path(options.output_path);
  CreateFolder(output_path / "gt");
  const SyntheticScene scene = SynthesizeScene(options.scene);
  const fs::path database_path = output_path / "database.db";
  WriteObservations(scene, database_path);
  const GivenPoses poses = SynthesizePosePriors(options.positions, scene);
  WritePosePriors(poses, scene, database_path.string());
  if (!poses.empty()) WriteOrigin(output_path / "gt" / "origin.txt");
  if (options.scene.rig != SyntheticRig::NONE) {
    WriteRigConfig(options.scene.rig, output_path / "rig_config.json");
  }
  std::map<std::string, double> depth_scales;
  for (const auto& [image_id, image] : scene.images) {
    if (!image.prior_depths.empty()) {
      depth_scales[image.name] = image.depth_scale;
    }
  }
  WriteTruth(
      output_path / "gt", ReconstructionFromSynthetic(scene), depth_scales);
}

void BindSceneOptions(SyntheticSceneOptions* scene, CommandOptions* options) {
  options->Add("num_images", &scene->num_images, "number of images");
  SyntheticCameraOptions& camera = scene->camera;
  options->Add("width", &camera.width_px, "image width [px]");
  options->Add("height", &camera.height_px, "image height [px]");
  options->Add("camera_model",
               &camera.model_name,
               "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV");
  options->Add("focal_length", &camera.focal_length_px, "focal length [px]");
  options->Add("radial_distortion",
               &camera.radial_distortion,
               "first radial coefficient [1], in [-0.2, 0.2]");
  options->Add("num_cameras",
               &camera.num_cameras,
               "cameras that the images share in turn; 0 is one per image");
  options->Add("num_distinct_cameras",
               &camera.num_distinct_cameras,
               "cameras that differ, the others are copies of them in turn; 0 "
               "is all");
  options->Add("max_log_focal_offset",
               &camera.max_log_focal_offset,
               "each camera's log focal length differs by up to this [1]");
  options->Add("max_log_size_offset",
               &camera.max_log_size_offset,
               "each camera's log width and height differ by up to this [1]");
  options->Add("max_distortion_offset",
               &camera.max_distortion_offset,
               "each camera's radial coefficient differs by up to this [1]");
  options->Add("portrait_ratio",
               &camera.portrait_ratio,
               "share of cameras in portrait format, in [0, 1]");
  options->Add("crop_ratio",
               &camera.crop_ratio,
               "share of cameras whose images are crops, in [0, 1] ...");
  options->Add("max_crop_offset",
               &camera.max_crop_offset,
               "... with a principal point off the centre by up to this "
               "[width, height]");
}

void BindDepthOptions(DepthNoiseOptions* noise_options,
                      CommandOptions* options) {
  DepthNoiseOptions& noise = *noise_options;
  options->Add("depth_scale_drift",
               &noise.log_scale_stddev,
               "standard deviation of the depth maps' log scales [1]");
  options->Add("depth_field",
               &noise.log_field_stddev,
               "standard deviation of the smooth log-depth error [1]");
  options->Add("depth_noise",
               &noise.log_noise_stddev,
               "standard deviation of the log-depth noise of a pixel [1]");
  options->Add("depth_outlier_ratio",
               &noise.outlier_ratio,
               "share of pixels with grossly wrong depth, in [0, 1)");
  options->Add("depth_noise_degrees_of_freedom",
               &noise.noise_degrees_of_freedom,
               "of Student's t distribution for depth_noise; 0 is normal");
  options->Add("depth_edge_radius",
               &noise.edge_radius_px,
               "depths mix with those of other surfaces nearer than this [px]");
  options->Add("depth_unrelated",
               &noise.unrelated_weight,
               "weight of a map unrelated to the scene, in [0, 1]");
}

void BindDatabaseOptions(SyntheticSceneOptions* scene,
                         CommandOptions* options) {
  options->Add("num_points_per_image",
               &scene->num_points_per_image,
               "(database) mean number of points that an image observes");
  options->Add("num_components",
               &scene->num_components,
               "(database) parts of the scene without common points");
  options->Add("component_step",
               &scene->component_step_m,
               "(database) how far these are apart along x [m], 0 = above each "
               "other");
  options->Add("sway",
               &scene->sway_m,
               "(database) centres of cameras are off by up to this along each "
               "axis [m]");
  options->Add("image_noise",
               &scene->image_noise_px,
               "(database) standard deviation of key points [px]");
  options->Add("outlier_match_ratio",
               &scene->outlier_match_ratio,
               "(database) share of wrong matches, in [0, 1)");
  options->Add("no_depth_ratio",
               &scene->no_depth_ratio,
               "(database) share of images without depth, in [0, 1)");
  options->Add("num_false_pairs",
               &scene->num_false_pairs,
               "(database) image pairs with consistent, but wrong matches");
  options->Add("max_num_look_alikes",
               &scene->max_num_look_alikes,
               "(database, repeats) such pairs of each image, at most");
  options->Add("max_num_neighbors",
               &scene->max_num_neighbors,
               "(database) images that an image is matched with, at least");
  options->Add("known_focal_length",
               &scene->known_focal_length,
               "(database) whether cameras have their true parameters");
}

void BindPositionOptions(PositionNoiseOptions* positions,
                         CommandOptions* options) {
  options->Add("gps",
               &positions->has_positions,
               "(database) whether images have position priors, in WGS84");
  options->Add("gps_noise",
               &positions->stddev_m,
               "(database) standard deviation of their coordinates [m]");
  options->Add("gps_outlier_ratio",
               &positions->outlier_ratio,
               "(database) share of wrong positions, in [0, 1] ...");
  options->Add("gps_outlier",
               &positions->outlier_m,
               "(database) ... which are off by this horizontally [m]");
  options->Add("gps_altitude_offset",
               &positions->altitude_offset_m,
               "(database) added to all altitudes [m]");
  options->Add("gravity",
               &positions->has_gravity,
               "(database) whether images have gravity");
  options->Add("gravity_noise",
               &positions->gravity_stddev_deg,
               "(database) its standard deviation [deg]");
  options->Add("gravity_outlier_ratio",
               &positions->gravity_outlier_ratio,
               "(database) share of images with a random gravity, in [0, 1]");
}

void BindOptions(std::string* family,
                 std::string* rig,
                 std::string* depth_model,
                 int* random_seed,
                 DepthSceneSynthesizerOptions* options,
                 CommandOptions* command_options) {
  command_options->AddRequired("output_path",
                               &options->output_path,
                               "new or empty folder for images/, depth/, gt/");
  command_options->Add("database_only",
                       &options->database_only,
                       "write database.db with depth instead of images");
  command_options->Add(
      "family",
      family,
      SceneFamilyNames() +
          "; images are rendered of ring, street and facade. Sets defaults of "
          "the options of cameras and matches");
  command_options->Add(
      "depth_model",
      depth_model,
      DepthModelNames() + ". Sets defaults of the options depth_...");
  command_options->Add(
      "rig",
      rig,
      "(database) none, stereo, cube (six images of 90 degrees) or vehicle "
      "(four cameras): images are those of a rig, as in rig_config.json");
  BindSceneOptions(&options->scene, command_options);
  BindDepthOptions(&options->scene.depth_noise, command_options);
  BindDatabaseOptions(&options->scene, command_options);
  BindPositionOptions(&options->positions, command_options);
  command_options->Add("random_seed", random_seed, "seed of all random draws");
  command_options->Add(
      "num_threads", &options->num_threads, "threads, -1 is one per core");
}

}  // namespace

bool DepthSceneSynthesizerOptions::IsValid(std::string* error) const {
  if (!scene.IsValid(error) || !positions.IsValid(error)) return false;
  if (num_threads == -1 || num_threads > 0) return true;
  *error = "num_threads = " + std::to_string(num_threads) +
           " must be -1 or positive";
  return false;
}

void SynthesizeDepthScene(const DepthSceneSynthesizerOptions& options) {
  CheckOptions(options);
  CreateEmptyFolder(options.output_path);
  if (options.database_only) {
    WriteDatabase(options);
  } else {
    WriteImagesAndDepth(options);
  }
}

int RunDepthSceneSynthesizer(int argc, char** argv) {
  DepthSceneSynthesizerOptions options;
  std::string family = "ring";
  std::string rig = "none";
  std::string depth_model = "network";
  int random_seed = 0;
  // The family and the depth model, read first, set the defaults of the others.
  for (int pass = 0; pass < 2; ++pass) {
    options = DepthSceneSynthesizerOptions();
    options.scene = SceneFamilyOptions(SceneFamilyFromName(family));
    options.scene.depth_noise = DepthModelFromName(depth_model);
    options.scene.num_images = 24;
    options.scene.num_points_per_image = 1000;
    options.scene.image_noise_px = 0.5;
    CommandOptions command_options(
        "depth_scene_synthesizer",
        "Writes a synthetic scene with exact truth: images and depth maps, or "
        "a database of observations.");
    BindOptions(
        &family, &rig, &depth_model, &random_seed, &options, &command_options);
    if (const auto exit_code = command_options.Parse(argc, argv)) {
      return *exit_code;
    }
  }
  options.scene.random_seed = static_cast<uint32_t>(random_seed);
  options.scene.rig = SyntheticRigFromName(rig);
  SynthesizeDepthScene(options);
  std::cout << "Wrote " << options.scene.num_images << " images "
            << (options.database_only ? "as observations in database.db"
                                      : "with depth maps")
            << " and their truth to " << options.output_path << std::endl;
  return 0;
}

}  // namespace dgsfm
