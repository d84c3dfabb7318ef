#include "controllers/part_joiner.h"

#include "colmap_ext/database/rig_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/model/rig_writer.h"
#include "colmap_ext/output_file.h"
#include "controllers/commands/commands.h"
#include "controllers/georeference_file.h"
#include "controllers/joined_model_writer.h"
#include "controllers/mapper_report.h"
#include "controllers/output_folder.h"
#include "controllers/part_model_reader.h"
#include "estimators/median.h"
#include "estimators/option_check.h"
#include "sfm/joining/position_placement.h"
#include "sfm/mapping/rig_model.h"
#include "sfm/mapping_context.h"

#include <filesystem>
#include <iomanip>
#include <iostream>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include <glog/logging.h>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// A model with what the report has of it.
struct FinishedModel {
  std::vector<std::string> part_names;
  std::vector<colmap::image_t> image_ids;
  size_t num_points = 0;
  size_t num_observations = 0;
  // Median of the mean reprojection errors of the points [px].
  std::optional<double> median_error_px;
  ModelGeoreference georeference;
};

Scene LoadScene(const PartJoinerOptions& options) {
  Scene scene = ReadScene(options.database_path, SceneContent::IMAGES);
  if (!options.ignore_rigs) {
    scene.rigs =
        ReadRigs(options.database_path, options.rig_config_path, scene);
  }
  return scene;
}

void BindPositions(PartJoinerOptions* options,
                   CommandOptions* command_options) {
  command_options->Add("image_path",
                       &options->image_path,
                       "folder of the images, for positions in EXIF data; "
                       "empty = none");
  BindPosePriors(&options->pose_priors, command_options);
  command_options->Add("georeference",
                       &options->georeferencing.georeference,
                       "whether models get the frame and unit of the positions "
                       "(east, north, up [m]), else they keep their own");
}

void BindAdjustment(BlockAdjustmentOptions* options,
                    CommandOptions* command_options) {
  OptionGroup("BlockAdjustment", command_options)
      .Add("max_num_sweeps",
           &options->max_num_sweeps,
           "adjustments of every part, 0 = none")
      .Add("min_cost_decrease",
           &options->min_cost_decrease,
           "relative decrease of the cost by a sweep that ends them [1]")
      .Add("max_reprojection_error",
           &options->max_reprojection_error_px,
           "observations farther off after the first sweep are removed [px]")
      .Add("adapt_loss",
           &options->adapt_loss,
           "whether the loss is adapted to the errors of the joined model")
      .Add("ba_max_num_iterations",
           &options->bundle_adjustment.max_num_iterations,
           "iterations of each adjustment of a part")
      .Add("ba_function_tolerance",
           &options->bundle_adjustment.function_tolerance,
           "relative decrease of the cost that ends it [1]")
      .Add("ba_loss_scale",
           &options->bundle_adjustment.loss_scale_px,
           "residual from which the soft L1 loss grows linearly, at most [px]");
}

void BindJoining(PartJoiningOptions* options, CommandOptions* command_options) {
  OptionGroup("PartJoining", command_options)
      .Add("min_num_shared_images",
           &options->min_num_shared_images,
           "images that two models must share to be compared")
      .Add("min_agreeing_share",
           &options->min_agreeing_share,
           "share of these that must agree [1]")
      .Add("max_rotation_error",
           &options->max_rotation_error_deg,
           "difference of rotations that agree [deg]")
      .Add("max_center_error",
           &options->max_center_error,
           "difference of centres that agree [median depth of the image]");
}

// The rigs as the parts have them; makes the model's frames rigid.
RigScene HoldFrames(const PartJoinerOptions& options,
                    const Scene& scene,
                    RigConstraints* constraints,
                    JoinedModel* model) {
  if (scene.rigs.Empty()) return {};
  std::set<colmap::camera_t> camera_ids =
      CamerasToCalibrate(scene.rigs, options.refine_sensor_from_rig);
  camera_ids.merge(TurnedSensors(model->poses, scene.rigs));
  RigScene rigs = CalibrateRigs(camera_ids, model->poses, scene.rigs);
  constraints->frames = MembersOf(rigs);
  JoinFrames(constraints->frames, &model->poses);
  constraints->fix_scale =
      !options.refine_sensor_from_rig &&
      HasBaseline(constraints->frames, model->poses.RegImageIds());
  return rigs;
}

void Adjust(const PartJoinerOptions& options,
            const RigConstraints& rigs,
            JoinedModel* model,
            MappingLog* log) {
  StageTimer timer("block_adjustment");
  const auto adjusted = AdjustBlocks(
      options.adjustment, options.num_threads, rigs, CenterPriors(), model);
  if (!adjusted) {
    throw std::runtime_error(
        "the adjustment of the joined model failed; "
        "--BlockAdjustment.max_num_sweeps 0 joins without it");
  }
  if (!adjusted->converged) {
    log->Warn("The adjustment of " + std::to_string(model->image_ids.size()) +
              " images has not converged after " +
              std::to_string(adjusted->num_sweeps) +
              " sweeps (--BlockAdjustment.max_num_sweeps)");
  }
  timer.Add("sweeps", adjusted->num_sweeps)
      .Add("observations_filtered", double(adjusted->num_filtered))
      .Add("rms_px", adjusted->final_robust_rms_px)
      .Add("points", double(model->NumPoints()));
  timer.Finish(&log->stages);
}

FinishedModel FinishModel(const PartJoinerOptions& options,
                          const Scene& scene,
                          const PartGroup& group,
                          const AddedKeypoints& added_keypoints,
                          const std::string& folder,
                          std::vector<PartModel>* parts,
                          MappingLog* log) {
  FinishedModel finished;
  for (const int part : group.parts) {
    finished.part_names.push_back((*parts)[part].name);
  }
  StageTimer timer("point_joining");
  JoinedModel model = JoinGroup(scene, group, parts);
  timer.Add("images", double(model.image_ids.size()))
      .Add("points", double(model.NumPoints()))
      .Add("observations", double(model.observations.size()));
  timer.Finish(&log->stages);
  RigConstraints constraints;
  const RigScene rigs = HoldFrames(options, scene, &constraints, &model);
  if (group.parts.size() > 1 && options.adjustment.max_num_sweeps > 0) {
    Adjust(options, constraints, &model, log);
    finished.median_error_px = Median(model.point_errors_px);
  }
  std::vector<std::string> warnings;
  finished.georeference = PlaceAtPositions(options.georeferencing,
                                           scene.pose_priors,
                                           constraints.fix_scale,
                                           &model,
                                           &warnings);
  for (const std::string& warning : warnings) log->Warn(warning);
  finished.image_ids = model.image_ids;
  finished.num_points = model.NumPoints();
  finished.num_observations = model.observations.size();
  WriteJoinedModel(model, *parts, added_keypoints, folder);
  if (!rigs.Empty()) WriteRigs(rigs, model.poses, folder);
  return finished;
}

Json ModelEntry(const Scene& scene, const FinishedModel& model) {
  Json entry = {{"parts", model.part_names},
                {"images", model.image_ids.size()},
                {"points", model.num_points},
                {"observations", model.num_observations}};
  if (model.median_error_px) entry["median_error_px"] = *model.median_error_px;
  if (model.georeference.num_positions > 0) {
    entry["positions"] = GeoreferenceEntry(scene, model.georeference);
  }
  return entry;
}

// One line an image, as text: collections may have a million.
std::string ImageLines(const Scene& scene,
                       const std::vector<FinishedModel>& models) {
  std::map<colmap::image_t, size_t> model_of_image;
  for (size_t i = 0; i < models.size(); ++i) {
    for (const colmap::image_t image_id : models[i].image_ids) {
      model_of_image.emplace(image_id, i);
    }
  }
  std::string lines;
  for (const auto& [image_id, image] : scene.images) {
    Json entry = {{"name", image.Name()}};
    const auto model = model_of_image.find(image_id);
    entry["registered"] = model != model_of_image.end();
    if (model == model_of_image.end()) {
      entry["reason"] = "no model of a part has it";
    } else {
      entry["model"] = model->second;
    }
    lines += (lines.empty() ? "\n    " : ",\n    ") + JsonText(entry, -1);
  }
  return lines;
}

// As the report of the mapper, without pairs, which joining does not see.
void WriteReport(const std::string& path,
                 const Scene& scene,
                 const std::vector<FinishedModel>& models,
                 const MappingLog& log) {
  Json report;
  report["stages"] = StageEntries(log.stages);
  report["models"] = Json::array();
  for (const FinishedModel& model : models) {
    report["models"].push_back(ModelEntry(scene, model));
  }
  report["warnings"] = log.warnings;
  report["view_graph"] = Json::array();
  std::string text = JsonText(report, 2);
  text.resize(text.size() - 2);  // Opens the closing brace for the images.
  WriteFile(
      path,
      text + ",\n  \"images\": [" + ImageLines(scene, models) + "\n  ]\n}\n");
}

std::string Describe(const std::vector<FinishedModel>& models,
                     const MappingLog& log,
                     const std::string& output_path) {
  std::ostringstream text;
  for (size_t i = 0; i < models.size(); ++i) {
    const FinishedModel& model = models[i];
    text << "model " << i << ": " << model.image_ids.size() << " images of "
         << model.part_names.size() << " parts, " << model.num_points
         << " points";
    if (model.median_error_px) {
      text << std::setprecision(2) << ", median error "
           << *model.median_error_px << " px";
    }
    text << "\n";
  }
  for (const std::string& warning : log.warnings) {
    text << "warning: " << warning << "\n";
  }
  text << "report: " << (fs::path(output_path) / kReportFile).string() << "\n";
  return text.str();
}

}  // namespace

void BindOptions(PartJoinerOptions* options, CommandOptions* command_options) {
  command_options->AddRequired(
      "database_path", &options->database_path, "COLMAP database");
  command_options->AddRequired(
      "input_paths",
      &options->input_paths,
      "folders of models of parts, with all models in them, separated by "
      "commas");
  command_options->AddRequired("output_path",
                               &options->output_path,
                               "folder of the models, created if missing; "
                               "models of an earlier run in it are replaced");
  command_options->Add(
      "num_threads", &options->num_threads, "threads, -1 = all cores");
  command_options->Add("ignore_rigs",
                       &options->ignore_rigs,
                       "whether images of rigs of several cameras move each by "
                       "itself");
  command_options->Add("rig_config_path",
                       &options->rig_config_path,
                       "rig_config.json of COLMAP's rig_configurator, in place "
                       "of the rigs of the database");
  command_options->Add("refine_sensor_from_rig",
                       &options->refine_sensor_from_rig,
                       "whether known poses of cameras in their rigs are those "
                       "of the parts; unknown ones, and those that the parts "
                       "contradict, always are");
  BindPositions(options, command_options);
  BindJoining(&options->joining, command_options);
  BindAdjustment(&options->adjustment, command_options);
}

bool PartJoinerOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Valid(pose_priors)
      .Valid(georeferencing)
      .Valid(joining)
      .Valid(adjustment)
      .AreKept();
}

std::string JoinParts(const PartJoinerOptions& options) {
  CheckOptions(options);
  RunFolder folder(options.output_path,
                   {kProjectFile, kReportFile, kGeoreferenceFile});
  CommandOptions command_options("", "");
  PartJoinerOptions copy = options;
  BindOptions(&copy, &command_options);
  command_options.WriteProject(folder.StagedFile(kProjectFile));

  MappingLog log;
  Scene scene = LoadScene(options);
  const LoadedPosePriors pose_priors = LoadPosePriors(
      options.pose_priors, options.database_path, options.image_path, scene);
  scene.pose_priors = pose_priors.priors;
  for (const std::string& warning : pose_priors.warnings) log.Warn(warning);
  StageTimer timer("part_joining");
  std::vector<PartModel> parts = ReadPartModels(options.input_paths, scene);
  const AddedKeypoints added_keypoints = UnifyKeypoints(&parts);
  const PartGroups grouped = GroupParts(
      options.joining,
      options.georeferencing.use_positions ? scene.pose_priors : PosePriors(),
      parts);
  for (const std::string& contradiction : grouped.contradictions) {
    log.Warn(contradiction);
  }
  timer.Add("parts", double(parts.size()))
      .Add("models", double(grouped.groups.size()))
      .Add("contradictions", double(grouped.contradictions.size()));
  timer.Finish(&log.stages);

  std::vector<FinishedModel> models;
  std::vector<ModelGeoreference> georeferences;
  for (size_t i = 0; i < grouped.groups.size(); ++i) {
    models.push_back(FinishModel(options,
                                 scene,
                                 grouped.groups[i],
                                 added_keypoints,
                                 folder.StagedModel(i),
                                 &parts,
                                 &log));
    georeferences.push_back(models.back().georeference);
  }
  WriteReport(folder.StagedFile(kReportFile), scene, models, log);
  if (pose_priors.frame && options.georeferencing.georeference) {
    WriteGeoreference(folder.StagedFile(kGeoreferenceFile),
                      *pose_priors.frame,
                      georeferences);
  }
  folder.Publish();
  return Describe(models, log, options.output_path);
}

int RunModelJoiner(int argc, char** argv) {
  PartJoinerOptions options;
  CommandOptions command_options(
      "model_joiner",
      "Joins models of overlapping parts of a database by the images they "
      "share, and adjusts the result.");
  BindOptions(&options, &command_options);
  if (const auto exit_code = command_options.Parse(argc, argv)) {
    return *exit_code;
  }
  std::cout << JoinParts(options) << std::flush;
  return 0;
}

}  // namespace dgsfm
