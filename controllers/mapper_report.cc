#include "controllers/mapper_report.h"

#include "colmap_ext/output_file.h"
#include "controllers/georeference_file.h"
#include "controllers/output_folder.h"
#include "sfm/intrinsics/prior_trust.h"
#include "sfm/mapping/shared_center.h"

#include <cmath>

#include <nlohmann/json.hpp>

namespace dgsfm {

namespace {

using Json = nlohmann::ordered_json;

// JSON has no infinity: null where nothing is known.
Json Numbers(const std::vector<double>& values) {
  Json numbers = Json::array();
  for (const double value : values) {
    numbers.push_back(std::isfinite(value) ? Json(value) : Json(nullptr));
  }
  return numbers;
}

Json CameraEntries(const Scene& scene, const DepthGlobalMapperResult& result) {
  Json entries = Json::array();
  for (const auto& [camera_id, camera] : scene.cameras) {
    Json entry = {{"camera_id", camera_id}, {"model", camera.ModelName()}};
    entry["intrinsics_prior"] = camera.HasPriorFocalLength() ? "calibrated"
                                : FocalPriorOf(scene, camera_id).Exists()
                                    ? "exif"
                                    : "none";
    const auto focal = result.focals.find(camera_id);
    if (focal != result.focals.end()) {
      entry["focal_source"] = FocalSourceName(focal->second.source);
      entry["averaged_focal_length_px"] = focal->second.focal_length_px;
      entry["num_estimates"] = focal->second.num_estimates;
      entry["log_spread"] = focal->second.log_spread;
    }
    const auto found = result.cameras.find(camera_id);
    if (found != result.cameras.end()) {
      const CameraResult& intrinsics = found->second;
      entry["prior"] = Numbers(camera.Params());
      entry["prior_stddevs"] = Numbers(intrinsics.prior_stddevs);
      entry["posterior"] = Numbers(intrinsics.params);
      entry["posterior_stddevs"] = Numbers(intrinsics.stddevs);
      entry["group"] = intrinsics.group;
    }
    entries.push_back(entry);
  }
  return entries;
}

Json FitEntry(const RelativeDepthFit& fit) {
  Json entry;
  if (!fit.fit.success) {
    entry["reason"] = fit.fit.reason;
    return entry;
  }
  entry["shift"] = fit.fit.shift;
  entry["shift_stddev"] = fit.fit.shift_stddev;
  entry["noise"] = fit.fit.noise;
  entry["num_points"] = fit.fit.num_samples;
  return entry;
}

// Scales have a meaning in the unit of a model alone.
Json RelativeDepthEntry(const RelativeDepthReport& fits,
                        colmap::image_t image_id) {
  const RelativeDepthFit& by_pairs = fits.by_pairs.at(image_id);
  Json entry;
  entry["used"] = by_pairs.fit.success;
  entry["by_pairs"] = FitEntry(by_pairs);
  if (by_pairs.fit.success) {
    entry["by_pairs"]["num_pairs"] = by_pairs.fit.num_pairs;
  }
  const auto by_model = fits.by_models.find(image_id);
  if (by_model == fits.by_models.end()) return entry;
  entry["by_model"] = FitEntry(by_model->second);
  if (by_model->second.fit.success) {
    entry["by_model"]["scale"] = by_model->second.fit.scales[0];
    entry["by_model"]["scale_stddev"] = by_model->second.fit.scale_stddevs[0];
  }
  return entry;
}

// Lists all images, so that a missing one can be found by its name.
Json ImageEntries(const Scene& scene,
                  const DepthGlobalMapperResult& result,
                  const RelativeDepthReport& relative_depths) {
  Json entries;
  for (const auto& [image_id, image] : scene.images) {
    Json entry;
    entry["name"] = image.Name();
    const auto missing = result.unregistered_images.find(image_id);
    entry["registered"] = missing == result.unregistered_images.end();
    if (missing != result.unregistered_images.end()) {
      entry["reason"] = missing->second;
    }
    const auto scale = result.depth_scales.find(image_id);
    if (scale != result.depth_scales.end()) {
      entry["depth_scale"] = scale->second;
    }
    if (relative_depths.by_pairs.count(image_id) > 0) {
      entry["relative_depth"] = RelativeDepthEntry(relative_depths, image_id);
    }
    entries.push_back(entry);
  }
  return entries;
}

// One line a pair: large collections have hundreds of thousands.
std::string PairLines(const Scene& scene, const PairGeometries& pairs) {
  std::string lines;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    Json entry = {{"image1", scene.images.at(image_id1).Name()},
                  {"image2", scene.images.at(image_id2).Name()},
                  {"status", PairStatusName(pair.status)},
                  {"num_matches", pair.num_matches},
                  {"num_inliers", pair.NumInliers()}};
    for (const PairVerdict& verdict : pair.verdicts) {
      entry["verdicts"].push_back({{"stage", PairStageName(verdict.stage)},
                                   {"status", PairStatusName(verdict.status)}});
    }
    lines += (lines.empty() ? "\n    " : ",\n    ") + JsonText(entry, -1);
  }
  return lines;
}

}  // namespace

Json StageEntries(const std::vector<StageReport>& stages) {
  Json entries;
  for (const StageReport& stage : stages) {
    Json entry;
    entry["stage"] = stage.stage;
    for (const auto& [figure, value] : stage.figures) entry[figure] = value;
    entry["seconds"] = stage.seconds;
    entry["cpu_seconds"] = stage.cpu_seconds;
    entry["peak_memory_mb"] = stage.peak_memory_mb;
    entries.push_back(entry);
  }
  return entries;
}

void WriteMapperReport(const std::string& path,
                       const Scene& scene,
                       const PairGeometries& pairs,
                       const std::optional<LocalFrame>& frame,
                       const DepthGlobalMapperResult& result,
                       const RelativeDepthReport& relative_depths) {
  Json report;
  report["stages"] = StageEntries(result.stages);
  const PairTotals totals = CountPairs(pairs);
  for (const auto& [status, count] : totals.num_with_status) {
    report["pairs"][PairStatusName(status)] = count;
  }
  for (const auto& [degeneracy, count] : totals.num_valid_with_degeneracy) {
    report["degenerate_valid_pairs"][PairDegeneracyName(degeneracy)] = count;
  }
  report["models"] = Json::array();
  for (size_t i = 0; i < result.models.size(); ++i) {
    report["models"].push_back(
        {{"images", result.models[i]->NumRegImages()},
         {"points", result.models[i]->NumPoints3D()},
         {"one_center", IsAtOneCenter(*result.models[i])},
         {"unit", ModelUnitName(result.units[i].unit)},
         {"images_with_depth_scale", result.units[i].num_images},
         {"depth_scale_median", std::exp(result.units[i].log_scale)},
         {"depth_scale_log_spread", result.units[i].log_spread}});
    if (i < result.georeferences.size() &&
        result.georeferences[i].num_positions > 0) {
      report["models"].back()["positions"] =
          GeoreferenceEntry(scene, result.georeferences[i]);
    }
  }
  if (frame) report["georeference"] = FrameEntry(*frame);
  report["warnings"] = result.warnings;
  if (result.repeatability) {
    const PoseMetrics& metrics = *result.repeatability;
    const std::vector<double> aucs =
        AreaUnderCurve(metrics.relative_errors_deg, {1, 3, 5});
    report["repeatability"] = {
        {"auc_1_3_5_deg", aucs},
        {"median_rotation_deg", metrics.median_rotation_error_deg},
        {"median_translation_deg", metrics.median_translation_error_deg}};
  }
  report["cameras"] = CameraEntries(scene, result);
  report["images"] = ImageEntries(scene, result, relative_depths);
  // The list of pairs is appended as text: as JSON in memory it would need
  // many times its size.
  std::string text = JsonText(report, 2);
  text.resize(text.size() - 2);  // Opens the closing brace for the pairs.
  WriteFile(
      path,
      text + ",\n  \"view_graph\": [" + PairLines(scene, pairs) + "\n  ]\n}\n");
}

}  // namespace dgsfm
