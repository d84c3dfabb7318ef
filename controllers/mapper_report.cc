#include "controllers/mapper_report.h"

#include <fstream>
#include <stdexcept>

#include <nlohmann/json.hpp>

namespace dgsfm {

namespace {

using Json = nlohmann::ordered_json;

Json StageEntries(const std::vector<StageReport>& stages) {
  Json entries;
  for (const StageReport& stage : stages) {
    Json entry;
    entry["stage"] = stage.stage;
    for (const auto& [figure, value] : stage.figures) entry[figure] = value;
    entry["seconds"] = stage.seconds;
    entry["peak_memory_mb"] = stage.peak_memory_mb;
    entries.push_back(entry);
  }
  return entries;
}

Json CameraEntries(const std::map<colmap::camera_t, CameraFocal>& focals) {
  Json entries;
  for (const auto& [camera_id, focal] : focals) {
    entries.push_back({{"camera_id", camera_id},
                       {"focal_source", FocalSourceName(focal.source)},
                       {"averaged_focal_length_px", focal.focal_length_px},
                       {"num_estimates", focal.num_estimates},
                       {"log_spread", focal.log_spread}});
  }
  return entries;
}

Json ImageEntries(const Scene& scene, const DepthGlobalMapperResult& result) {
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
    entries.push_back(entry);
  }
  return entries;
}

}  // namespace

void WriteMapperReport(const std::string& path,
                       const Scene& scene,
                       const PairGeometries& pairs,
                       const DepthGlobalMapperResult& result) {
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
  for (const auto& model : result.models) {
    report["models"].push_back(
        {{"images", model->NumRegImages()}, {"points", model->NumPoints3D()}});
  }
  if (!result.focals.empty()) {
    report["cameras"] = CameraEntries(result.focals);
  }
  report["images"] = ImageEntries(scene, result);
  std::ofstream file(path);
  file << report.dump(2) << std::endl;
  if (!file) throw std::runtime_error("cannot write " + path);
}

}  // namespace dgsfm
