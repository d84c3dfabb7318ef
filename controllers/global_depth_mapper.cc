#include "controllers/global_depth_mapper.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/keypoint_selection.h"
#include "colmap_ext/database/match_reader.h"
#include "colmap_ext/database/rig_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/model/model_writer.h"
#include "colmap_ext/model/rig_writer.h"
#include "colmap_ext/output_file.h"
#include "controllers/component_checkpoints.h"
#include "controllers/georeference_file.h"
#include "controllers/image_list.h"
#include "controllers/mapper_checks.h"
#include "controllers/mapper_report.h"
#include "controllers/mapper_summary.h"
#include "controllers/pair_score_file.h"
#include "controllers/point_colors.h"
#include "controllers/relative_depth_stage.h"
#include "controllers/report/report_page.h"
#include "sfm/mapping/depth_kind_check.h"
#include "sfm/mapping_fingerprint.h"
#include "sfm/memory_prediction.h"

#include <filesystem>
#include <memory>
#include <sstream>
#include <stdexcept>

#include <glog/logging.h>

namespace dgsfm {

namespace {

namespace fs = std::filesystem;

constexpr char kPageFile[] = "report.html";

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
  const RigScene rigs =
      ReadRigs(options.verifier.database_path, options.rig_config_path, scene);
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

void WarnOfDepthKinds(const Scene& scene,
                      const KeypointDepthMap& given_depths,
                      DepthGlobalMapperResult* result) {
  for (const std::string& warning :
       WarningsOfDepthKinds(scene, given_depths, result->models)) {
    LOG(WARNING) << warning;
    result->warnings.push_back(warning);
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
  command_options.WriteProject(folder.StagedFile(kProjectFile));
  std::vector<StageReport> stages;
  MapperInput input;
  LoadInput(&input, &stages);
  PairGeometries pairs = LoadOrVerifyPairs(
      input.scene, input.depths, input.relative.conversions, &stages);
  PredictMemory(input.scene, pairs, &stages);
  ComponentCheckpoints checkpoints(options_.output_path,
                                   MappingFingerprint(MappingText(options_),
                                                      input.scores,
                                                      input.scene,
                                                      input.depths,
                                                      pairs));
  // The report shows cameras as the database has them.
  const CameraMap given_cameras = input.scene.cameras;
  DepthGlobalMapperResult result =
      RunGlobalMapping(options_.mapper,
                       options_.verifier.verification,
                       input.scores,
                       &input.scene,
                       &input.depths,
                       &pairs,
                       &checkpoints);
  input.scene.cameras = given_cameras;
  // All maps as they were imported: those that no stage converted are moved.
  KeypointDepthMap& given_depths = input.affine_depths;
  given_depths.merge(result.dropped_depths);
  given_depths.merge(input.depths);
  WarnOfDepthKinds(input.scene, given_depths, &result);
  result.stages.insert(result.stages.begin(), stages.begin(), stages.end());
  WarnOfPositions(options_.mapper.georeferencing, input.pose_priors, &result);
  StageModels(folder, &result);
  StageReports(options_,
               folder,
               input.scene,
               pairs,
               input.pose_priors.frame,
               {input.relative.fits,
                FitRelativeDepthsToModels(given_depths, result.models)},
               result);
  if (options_.WritesHtmlReport()) {
    StageReportPage(folder, result.models.size());
  }
  folder.Publish();
  checkpoints.Remove();
  // The table is of all pairs of the database.
  if (options_.write_pair_statuses && options_.image_list_path.empty()) {
    WritePairStatuses(pairs);
  }
  return Summarize(input.scene, result, options_.output_path);
}

void GlobalDepthMapper::LoadInput(MapperInput* input,
                                  std::vector<StageReport>* stages) const {
  Scene& scene = input->scene;
  std::optional<ImageNames> names;
  if (!options_.image_list_path.empty()) {
    names = ReadImageList(options_.image_list_path);
  }
  scene = LoadScene(
      options_.verifier, options_.max_num_keypoints_per_image, names, stages);
  scene.match_source = std::make_shared<const StoredMatches>(
      options_.verifier.database_path, scene);
  scene.rigs = LoadRigs(options_, scene);
  if (!options_.image_path.empty()) {
    CheckImagesExist(options_.image_path, scene);
    if (options_.use_exif) ReadExif(options_.image_path, &scene);
  }
  input->pose_priors =
      LoadPosePriors(options_.pose_priors,
                     options_.verifier.database_path,
                     options_.use_exif ? options_.image_path : "",
                     scene);
  scene.pose_priors = input->pose_priors.priors;
  input->depths = LoadDepths(options_.verifier, scene, stages);
  if (!options_.image_path.empty()) {
    WarnOfTurnedImages(options_, scene, input->depths);
  }
  input->affine_depths = AffineDepthsOf(input->depths);
  input->relative =
      ConvertRelativeDepths(options_.verifier, &scene, &input->depths, stages);
  if (options_.memory_limit_gb > 0) {
    CheckMemory(
        options_.memory_limit_gb, options_.mapper.tracks, SizeByMatches(scene));
  }
  if (!options_.pair_scores_path.empty()) {
    input->scores = ReadPairScores(options_.pair_scores_path, scene);
  }
}

void GlobalDepthMapper::PredictMemory(const Scene& scene,
                                      const PairGeometries& pairs,
                                      std::vector<StageReport>* stages) const {
  StageTimer timer("memory_prediction");
  timer
      .Add("predicted_gb",
           PredictMemoryGb(options_.mapper.tracks, SizeByInliers(scene, pairs)))
      .Finish(stages);
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
    if (result->rigs[i].Empty()) continue;
    WriteRigs(result->rigs[i], model, folder.StagedModel(i));
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

}  // namespace dgsfm
