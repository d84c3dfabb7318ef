#include "controllers/georeference_file.h"

#include "colmap_ext/output_file.h"
#include "controllers/output_folder.h"

namespace dgsfm {

namespace {

using Json = nlohmann::ordered_json;

Json OriginEntry(const LocalFrame& frame) {
  return {{"latitude_deg", frame.Origin().latitude_deg},
          {"longitude_deg", frame.Origin().longitude_deg},
          {"altitude_m", frame.Origin().altitude_m}};
}

}  // namespace

Json GeoreferenceEntry(const Scene& scene,
                       const ModelGeoreference& georeference) {
  Json entry = {
      {"georeferenced", georeference.is_georeferenced},
      {"images_with_position", georeference.num_positions},
      {"inliers", georeference.num_inliers},
      {"spread", georeference.spread},
      {"median_horizontal_error_m", georeference.median_horizontal_error_m},
      {"median_vertical_error_m", georeference.median_vertical_error_m},
      {"rotation_stddev_deg", georeference.rotation_stddev_deg},
      {"scale_source", ScaleSourceName(georeference.scale_source)},
      {"log_scale_stddev_of_positions",
       georeference.log_scale_stddev_of_positions}};
  if (georeference.scale_of_depth > 0) {
    entry["scale_by_depth_over_positions"] = georeference.scale_of_depth;
    entry["log_scale_stddev_of_depth"] = georeference.log_scale_stddev_of_depth;
  }
  if (georeference.scale_of_rigs > 0) {
    entry["scale_by_rigs_over_positions"] = georeference.scale_of_rigs;
  }
  if (georeference.part_sizes.size() > 1) {
    entry["parts_without_common_matches"] = georeference.part_sizes;
  }
  for (const auto& [image_id, error] : georeference.errors) {
    entry["position_errors_m"][scene.images.at(image_id).Name()] = {
        error.x(), error.y(), error.z()};
  }
  return entry;
}

Json FrameEntry(const LocalFrame& frame) {
  return {{"axes", "x east, y north, z up [m]"},
          {"ellipsoid", "WGS84"},
          {"origin", OriginEntry(frame)}};
}

void WriteGeoreference(const std::string& path,
                       const LocalFrame& frame,
                       const std::vector<ModelGeoreference>& georeferences) {
  Json json = FrameEntry(frame);
  json["proj_pipeline"] = frame.ProjPipeline();
  json["wkt"] = frame.Wkt();
  const Eigen::Matrix4d ecef_from_local = frame.EcefFromLocal();
  for (int row = 0; row < 4; ++row) {
    Json values = Json::array();
    for (int col = 0; col < 4; ++col) {
      values.push_back(ecef_from_local(row, col));
    }
    json["ecef_from_local"].push_back(values);
  }
  json["models"] = Json::array();
  for (size_t i = 0; i < georeferences.size(); ++i) {
    if (georeferences[i].is_georeferenced) {
      json["models"].push_back(std::to_string(i));
    }
  }
  WriteFile(path, JsonText(json, 2) + "\n");
}

}  // namespace dgsfm
