#include "controllers/global_depth_mapper.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/keypoint_selection.h"
#include "colmap_ext/database/match_reader.h"
#include "colmap_ext/database/rig_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/image_orientation.h"
#include "colmap_ext/model/model_writer.h"
#include "colmap_ext/model/rig_writer.h"
#include "colmap_ext/output_file.h"
#include "controllers/commands/commands.h"
#include "controllers/component_checkpoints.h"
#include "controllers/georeference_file.h"
#include "controllers/image_list.h"
#include "controllers/mapper_report.h"
#include "controllers/mapper_summary.h"
#include "controllers/pair_score_file.h"
#include "controllers/part_model_reader.h"
#include "controllers/point_colors.h"
#include "controllers/relative_depth_stage.h"
#include "controllers/report/report_page.h"
#include "sfm/mapping/depth_kind_check.h"
#include "sfm/mapping/rig_model.h"
#include "sfm/mapping_fingerprint.h"
#include "sfm/memory_prediction.h"

#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <set>
#include <sstream>
#include <stdexcept>

#include <glog/logging.h>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

constexpr char kPageFile[] = "report.html";
constexpr char kGeoreferenceFile[] = "georeference.json";

void CheckImagesExist(const std::string& image_path, const Scene& scene) {
  size_t num_missing = 0;
  std::string first_missing;
  for (const auto& [image_id, image] : scene.images) {
    if (fs::exists(PathInside(image_path, image.Name()))) continue;
    if (num_missing++ == 0) first_missing = image.Name();
  }
  if (num_missing > 0) {
    throw std::runtime_error(
        image_path + " lacks " + std::to_string(num_missing) + " of " +
        std::to_string(scene.images.size()) + " images, e.g. " + first_missing +
        "; leave --image_path out to map without colours");
  }
}

void ReadExif(const std::string& image_path, Scene* scene) {
  for (const auto& [image_id, image] : scene->images) {
    const colmap::camera_t camera_id = image.CameraId();
    if (scene->cameras.at(camera_id).HasPriorFocalLength() ||
        scene->exif.count(camera_id) > 0) {
      continue;
    }
    const std::string path = PathInside(image_path, image.Name());
    try {
      scene->exif[camera_id] = ReadImageExif(path);
    } catch (const std::runtime_error& error) {
      LOG(WARNING) << "No EXIF data: " << error.what();
    }
  }
}

// Positions whose latitude and longitude are swapped show by the shape of the
// largest model.
void CheckForSwappedCoordinates(const GeoreferencingOptions& options,
                                const LoadedPosePriors& loaded,
                                DepthGlobalMapperResult* result) {
  if (result->models.empty() || loaded.swapped_priors.empty()) return;
  const colmap::Reconstruction& model = *result->models.front();
  const auto given =
      AlignToPositions(options, loaded.priors, std::nullopt, model);
  const auto swapped =
      AlignToPositions(options, loaded.swapped_priors, std::nullopt, model);
  constexpr double kMinRatio = 3;  // of the errors
  if (!given || !swapped || given->spread < kMinRatio * swapped->spread ||
      given->spread < kMinRatio) {
    return;
  }
  result->warnings.push_back(
      "Latitude and longitude of the positions seem to be swapped: swapped "
      "back, they fit the largest model better");
  LOG(WARNING) << result->warnings.back();
}

void WarnOfPositions(const GeoreferencingOptions& options,
                     const LoadedPosePriors& loaded,
                     DepthGlobalMapperResult* result) {
  for (const std::string& warning : loaded.warnings) {
    LOG(WARNING) << "Positions of images: " << warning;
    result->warnings.push_back("Positions of images: " + warning);
  }
  CheckForSwappedCoordinates(options, loaded, result);
}

// Maps of images turned by a quarter have another shape, and were refused.
void WarnOfTurnedImages(const GlobalDepthMapperOptions& options,
                        const Scene& scene,
                        const KeypointDepthMap& depths) {
  const std::string& image_path = options.image_path;
  const std::set<colmap::image_t> turned_back =
      DepthDatabase(options.verifier.database_path,
                    DepthDatabase::Mode::READ_ONLY)
          .ReadDisplayedImages();
  std::vector<std::string> names;
  for (const auto& [image_id, image_depths] : depths) {
    if (turned_back.count(image_id) > 0) continue;
    const colmap::Image& image = scene.images.at(image_id);
    const colmap::Camera& camera = scene.cameras.at(image.CameraId());
    try {
      const int orientation =
          ReadExifOrientation(PathInside(image_path, image.Name()));
      const bool has_other_shape =
          orientation >= 5 && camera.Width() != camera.Height();
      if (orientation != 1 && !has_other_shape) names.push_back(image.Name());
    } catch (const std::runtime_error& error) {
      LOG(WARNING) << "No EXIF data: " << error.what();
    }
  }
  if (names.empty()) return;
  LOG(WARNING) << names.size() << " images with depth, e.g. " << names.front()
               << ", are turned by EXIF in a way that the shape of a map does "
                  "not show: if their maps were made of the images as viewers "
                  "show them, they must have been imported with "
                  "depth_importer --displayed_image_path";
}

// Maps of unknown scale and shift, which are converted before they are used.
KeypointDepthMap AffineDepthsOf(const KeypointDepthMap& depths) {
  KeypointDepthMap affine;
  for (const auto& [image_id, image_depths] : depths) {
    if (IsAffine(image_depths.unit)) affine.emplace(image_id, image_depths);
  }
  return affine;
}

RigScene LoadRigs(const GlobalDepthMapperOptions& options, const Scene& scene) {
  if (options.ignore_rigs) return {};
  const RigScene rigs = options.rig_config_path.empty()
                            ? ReadRigs(options.verifier.database_path, scene)
                            : ReadRigConfig(options.rig_config_path, scene);
  if (!rigs.Empty()) {
    LOG(INFO) << rigs.rigs.size() << " rigs, " << rigs.frames.size()
              << " frames of several images";
  }
  return rigs;
}

std::string PairName(const Scene& scene, colmap::image_pair_t pair_id) {
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  return scene.images.at(image_id1).Name() + ", " +
         scene.images.at(image_id2).Name();
}

void StageReports(const GlobalDepthMapperOptions& options,
                  const RunFolder& folder,
                  const Scene& scene,
                  const PairGeometries& pairs,
                  const std::optional<LocalFrame>& frame,
                  const RelativeDepthReport& relative_depths,
                  const DepthGlobalMapperResult& result) {
  WriteMapperReport(folder.StagedFile(kReportFile),
                    scene,
                    pairs,
                    frame,
                    result,
                    relative_depths);
  if (frame && options.mapper.georeferencing.georeference) {
    WriteGeoreference(
        folder.StagedFile(kGeoreferenceFile), *frame, result.georeferences);
  }
}

GlobalDepthMapperSummary Summarize(const Scene& scene,
                                   const DepthGlobalMapperResult& result,
                                   const std::string& output_path) {
  GlobalDepthMapperSummary summary;
  summary.output_path = output_path;
  summary.text = MapperSummary(scene, result, output_path);
  for (size_t i = 0; i < result.models.size(); ++i) {
    summary.model_paths.push_back(
        (fs::path(output_path) / std::to_string(i)).string());
  }
  return summary;
}

}  // namespace

std::string GlobalDepthMapperSummary::FailureText() const {
  return "no model could be reconstructed, see " +
         (fs::path(output_path) / kReportFile).string();
}

GlobalDepthMapper::GlobalDepthMapper(const GlobalDepthMapperOptions& options)
    : options_(options) {}

GlobalDepthMapperSummary GlobalDepthMapper::Run() {
  CheckOptions(options_.verifier);
  CheckOptions(options_.mapper);
  CheckOptions(options_.pose_priors);
  RunFolder folder(options_.output_path,
                   {kProjectFile, kReportFile, kPageFile, kGeoreferenceFile});
  CommandOptions command_options("", "");
  BindOptions(&options_, &command_options);
  if (!options_.part_paths.empty()) {
    BindPartJoining(&options_, &command_options);
  }
  command_options.WriteProject(folder.StagedFile(kProjectFile));
  std::vector<StageReport> stages;
  std::optional<ImageNames> names;
  if (!options_.image_list_path.empty()) {
    names = ReadImageList(options_.image_list_path);
  }
  Scene scene = LoadScene(
      options_.verifier, options_.max_num_keypoints_per_image, names, &stages);
  const std::vector<PartModel> parts =
      ReadPartModels(options_.part_paths, scene);
  scene.match_source = std::make_shared<const StoredMatches>(
      options_.verifier.database_path, scene);
  scene.rigs = LoadRigs(options_, scene);
  if (!options_.image_path.empty()) {
    CheckImagesExist(options_.image_path, scene);
    if (options_.use_exif) ReadExif(options_.image_path, &scene);
  }
  const LoadedPosePriors pose_priors =
      LoadPosePriors(options_.pose_priors,
                     options_.verifier.database_path,
                     options_.use_exif ? options_.image_path : "",
                     scene);
  scene.pose_priors = pose_priors.priors;
  KeypointDepthMap depths = LoadDepths(options_.verifier, scene, &stages);
  if (!options_.image_path.empty()) {
    WarnOfTurnedImages(options_, scene, depths);
  }
  KeypointDepthMap given_depths = AffineDepthsOf(depths);
  const RelativeDepths relative =
      ConvertRelativeDepths(options_.verifier, &scene, &depths, &stages);
  if (options_.memory_limit_gb > 0) {
    CheckMemory(
        options_.memory_limit_gb, options_.mapper.tracks, SizeByMatches(scene));
  }
  PairScores scores;
  if (!options_.pair_scores_path.empty()) {
    scores = ReadPairScores(options_.pair_scores_path, scene);
  }
  PairGeometries pairs =
      LoadOrVerifyPairs(scene, depths, relative.conversions, &stages);

  {
    StageTimer timer("memory_prediction");
    timer
        .Add("predicted_gb",
             PredictMemoryGb(options_.mapper.tracks,
                             SizeByInliers(scene, pairs)))
        .Finish(&stages);
  }
  ComponentCheckpoints checkpoints(
      options_.output_path,
      MappingFingerprint(MappingText(options_), scores, scene, depths, pairs));
  // The report shows cameras as the database has them.
  const CameraMap given_cameras = scene.cameras;
  DepthGlobalMapperResult result =
      RunGlobalMapping(options_.mapper,
                       options_.verifier.verification,
                       scores,
                       &scene,
                       &depths,
                       &pairs,
                       &checkpoints,
                       parts);
  scene.cameras = given_cameras;
  // All maps as they were imported: those that no stage converted are moved.
  given_depths.merge(result.dropped_depths);
  given_depths.merge(depths);
  for (const std::string& warning :
       WarningsOfDepthKinds(scene, given_depths, result.models)) {
    LOG(WARNING) << warning;
    result.warnings.push_back(warning);
  }
  result.stages.insert(result.stages.begin(), stages.begin(), stages.end());
  WarnOfPositions(options_.mapper.georeferencing, pose_priors, &result);
  StageModels(folder, scene.rigs, &result);
  StageReports(
      options_,
      folder,
      scene,
      pairs,
      pose_priors.frame,
      {relative.fits, FitRelativeDepthsToModels(given_depths, result.models)},
      result);
  if (options_.WritesHtmlReport()) {
    StageReportPage(folder, result.models.size());
  }
  folder.Publish();
  checkpoints.Remove();
  // The table is of all pairs of the database.
  if (options_.write_pair_statuses && !names) WritePairStatuses(pairs);

  return Summarize(scene, result, options_.output_path);
}

PairGeometries GlobalDepthMapper::LoadOrVerifyPairs(
    const Scene& scene,
    const KeypointDepthMap& depths,
    const AffineDepths& conversions,
    std::vector<StageReport>* stages) const {
  const DepthGeometricVerifierOptions& options = options_.verifier;
  StageTimer timer("pair_verification");
  PairGeometries pairs;
  if (options.use_depth) {
    pairs = DepthDatabase(options.database_path, DepthDatabase::Mode::READ_ONLY)
                .ReadPairGeometries(
                    scene.kept_keypoints, [&](colmap::image_pair_t pair_id) {
                      const auto [image_id1, image_id2] =
                          ImageIdsOfPair(pair_id);
                      return scene.images.count(image_id1) > 0 &&
                             scene.images.count(image_id2) > 0;
                    });
  }
  DatabasePairVerifier::Fingerprints fingerprints;
  for (const auto& [pair_id, pair] : pairs) {
    fingerprints[pair_id] = pair.fingerprint;
  }
  DatabasePairVerifier verifier = CreatePairVerifier(options, scene, depths);
  verifier.SetConversions(conversions);
  const auto comparison = verifier.Compare(verifier.ListPairs(), fingerprints);
  for (const colmap::image_pair_t pair_id : comparison.stale) {
    pairs.erase(pair_id);
  }
  if (!fingerprints.empty() && !comparison.work.empty()) {
    LOG(WARNING) << comparison.work.size() << " pairs, e.g. "
                 << PairName(scene, comparison.work.front().pair_id)
                 << ", are not verified yet, or of other matches, depths or "
                    "options, or by another version of this program: they "
                    "are verified now";
  }
  const PairStore store =
      comparison.work.empty() ? PairStore() : OpenPairStore(comparison.stale);
  VerifyAndStore(
      options,
      comparison.work,
      [&](const PairGeometries& finished) {
        if (store) store(finished);
        for (const auto& [pair_id, pair] : finished) {
          RestrictInliers(
              scene.kept_keypoints, pair_id, &(pairs[pair_id] = pair));
        }
      },
      &verifier);
  if (!scene.kept_keypoints.empty()) {
    for (auto& [pair_id, pair] : pairs) {
      pair.num_matches = MatchesOf(scene, pair_id).size();
    }
  }
  timer.Add("kept", double(comparison.holding.size()))
      .Add(CountPairs(pairs))
      .Finish(stages);
  return pairs;
}

PairStore GlobalDepthMapper::OpenPairStore(
    const std::vector<colmap::image_pair_t>& stale) const {
  if (!options_.write_pair_statuses || !options_.verifier.use_depth) return {};
  const auto warn = [](const std::runtime_error& error) {
    LOG(WARNING) << "A run that is broken off has to verify its pairs again, "
                    "as they cannot be stored: "
                 << error.what();
  };
  try {
    auto database = std::make_shared<DepthDatabase>(
        options_.verifier.database_path, DepthDatabase::Mode::READ_WRITE);
    database->DeletePairGeometries(stale);
    return [database, warn](const PairGeometries& pairs) mutable {
      if (!database) return;
      try {
        database->WritePairGeometries(pairs);
      } catch (const std::runtime_error& error) {
        warn(error);
        database = nullptr;
      }
    };
  } catch (const std::runtime_error& error) {
    warn(error);
    return {};
  }
}

void GlobalDepthMapper::StageModels(const RunFolder& folder,
                                    const RigScene& rigs,
                                    DepthGlobalMapperResult* result) {
  StageTimer timer("write_models");
  for (size_t i = 0; i < result->models.size(); ++i) {
    if (!options_.image_path.empty()) {
      ExtractPointColors(options_.image_path,
                         options_.verifier.verification.num_threads,
                         result->models[i].get());
    }
    const colmap::Reconstruction& model = *result->models[i];
    WriteModel(model, folder.StagedModel(i));
    if (rigs.Empty()) continue;
    const std::set<colmap::camera_t> calibrated =
        CamerasToCalibrate(rigs, options_.mapper.refine_sensor_from_rig);
    WriteRigs(
        CalibrateRigs(calibrated, model, rigs), model, folder.StagedModel(i));
  }
  timer.Add("models", double(result->models.size()));
  timer.Finish(&result->stages);
}

// Nor is a page that cannot be written a reason to lose the models.
void GlobalDepthMapper::StageReportPage(const RunFolder& folder,
                                        size_t num_models) const {
  ReportPageInput input;
  input.title = FolderName(options_.output_path);
  for (size_t i = 0; i < num_models; ++i) {
    input.model_folders.push_back(folder.StagedModel(i));
  }
  input.report_path = folder.StagedFile(kReportFile);
  input.project_path = folder.StagedFile(kProjectFile);
  input.image_path = options_.image_path;
  input.num_threads = options_.verifier.verification.num_threads;
  try {
    WriteReportPage(input, folder.StagedFile(kPageFile));
  } catch (const std::exception& error) {
    LOG(WARNING) << "There is no " << kPageFile << ": " << error.what();
  }
}

// The models are what the user waits for: a database that cannot be written is
// no reason to fail at the end.
void GlobalDepthMapper::WritePairStatuses(const PairGeometries& pairs) const {
  std::map<colmap::image_pair_t, PairStatus> statuses;
  for (const auto& [pair_id, pair] : pairs) {
    statuses.emplace_hint(statuses.end(), pair_id, pair.status);
  }
  try {
    DepthDatabase(options_.verifier.database_path,
                  DepthDatabase::Mode::READ_WRITE)
        .WritePairStatuses(statuses);
  } catch (const std::runtime_error& error) {
    LOG(WARNING) << "The statuses of the pairs are only in " << kReportFile
                 << ", not in the database: " << error.what();
  }
}

namespace {

int RunMapper(int argc,
              char** argv,
              const std::string& command,
              const std::string& summary,
              const std::function<void(GlobalDepthMapperOptions*,
                                       CommandOptions*)>& bind) {
  GlobalDepthMapperOptions options;
  std::optional<int> exit_code;
  SetOverPreset(
      [&] {
        CommandOptions command_options(command, summary);
        bind(&options, &command_options);
        exit_code = command_options.Parse(argc, argv);
      },
      &options);
  if (exit_code) return *exit_code;
  const GlobalDepthMapperSummary result = GlobalDepthMapper(options).Run();
  std::cout << result.text << std::flush;
  if (!result.model_paths.empty()) return 0;
  std::cerr << "ERROR: " << result.FailureText() << std::endl;
  return 1;
}

}  // namespace

int RunDepthGlobalMapper(int argc, char** argv) {
  return RunMapper(argc,
                   argv,
                   "depth_global_mapper",
                   "Reconstructs a database with depth priors by global "
                   "structure from motion.",
                   [](auto* options, auto* command_options) {
                     BindOptions(options, command_options);
                   });
}

int RunModelJoiner(int argc, char** argv) {
  return RunMapper(argc,
                   argv,
                   "model_joiner",
                   "Joins models of overlapping parts of a database by the "
                   "images they share, and adjusts the result.",
                   [](auto* options, auto* command_options) {
                     BindPartJoining(options, command_options);
                     BindOptions(options, command_options);
                   });
}

}  // namespace dgsfm
