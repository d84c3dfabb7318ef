#include "controllers/report/report_page.h"

#include "colmap_ext/output_file.h"
#include "controllers/output_folder.h"
#include "controllers/report/base64.h"
#include "controllers/report/mapper_results.h"
#include "controllers/report/model_summary.h"
#include "controllers/report/page_template.h"
#include "controllers/report/thumbnails.h"
#include "estimators/optimization/ray_intersection.h"

#include <algorithm>
#include <filesystem>
#include <limits>

#include <boost/algorithm/string/replace.hpp>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// A model with this much turns fluidly on a computer without a graphics card,
// and has half of the 25 MB of a page.
constexpr size_t kMaxNumPoints = 200000;
constexpr size_t kMaxNumViews = 1800000;
constexpr size_t kMaxThumbnailBytes = 5000000;

// All names of images of models and report, in the order of their names, with
// the indices that the page has for them.
using ImageIndices = std::map<std::string, uint32_t>;

// The middle of the cameras, relative to which coordinates of 32 bits are exact
// enough.
Eigen::Vector3d MiddleOf(const ModelSummary& model) {
  std::vector<Eigen::Vector3d> centers;
  for (const auto& [name, image] : model.images) {
    centers.push_back(image.cam_from_world.TargetOriginInSource());
  }
  if (centers.empty()) return Eigen::Vector3d::Zero();
  return ComponentwiseMedian(centers);
}

Json PointEntries(const ModelSummary& model,
                  const Eigen::Vector3d& origin,
                  const std::vector<uint32_t>& index_of_image) {
  std::vector<float> positions;
  std::vector<uint8_t> colors;
  std::vector<uint32_t> track_lengths;
  std::vector<uint32_t> images;
  std::vector<uint8_t> view_positions;
  for (const ShownPoint& shown : model.shown_points) {
    for (int axis = 0; axis < 3; ++axis) {
      positions.push_back(float(shown.point.xyz(axis) - origin(axis)));
      colors.push_back(shown.point.color(axis));
    }
    track_lengths.push_back(shown.views.size());
    for (const ShownView& view : shown.views) {
      images.push_back(index_of_image[view.image]);
      view_positions.push_back(view.x);
      view_positions.push_back(view.y);
    }
  }
  // Most data of a page are these.
  const bool is_short =
      std::all_of(images.begin(), images.end(), [](uint32_t image) {
        return image <= std::numeric_limits<uint16_t>::max();
      });
  return {
      {"count", model.shown_points.size()},
      {"positions", ToBase64(positions)},
      {"colors", ToBase64(colors)},
      {"track_lengths", ToBase64(track_lengths)},
      {"view_image_bytes", is_short ? 2 : 4},
      {"view_images",
       is_short ? ToBase64(std::vector<uint16_t>(images.begin(), images.end()))
                : ToBase64(images)},
      {"view_positions", ToBase64(view_positions)}};
}

Json CameraEntries(const ModelSummary& model) {
  Json entries = Json::object();
  for (const auto& [camera_id, camera] : model.cameras) {
    entries[std::to_string(camera_id)] = {{"model", camera.ModelName()},
                                          {"width", camera.Width()},
                                          {"height", camera.Height()},
                                          {"params", camera.Params()}};
  }
  return entries;
}

// Adds the model's figures to the entries of its images.
Json ModelEntry(const std::string& folder,
                size_t model_index,
                const ModelSummary& model,
                const ImageIndices& indices,
                Json* image_entries) {
  const Eigen::Vector3d origin = MiddleOf(model);
  std::vector<uint32_t> index_of_image;
  for (const auto& [name, image] : model.images) {
    const uint32_t index = indices.at(PrintableName(name));
    index_of_image.push_back(index);
    const Rigid3d world_from_cam = image.cam_from_world.Inverse();
    const Eigen::Vector3d center = world_from_cam.translation - origin;
    const Eigen::Quaterniond& rotation = world_from_cam.rotation;
    Json& entry = (*image_entries)[index];
    entry["model"] = model_index;
    entry["camera_id"] = image.camera_id;
    entry["num_points"] = image.num_points;
    entry["coverage"] = image.coverage;
    entry["median_error_px"] = image.median_error_px;
    entry["center"] = {center.x(), center.y(), center.z()};
    entry["rotation"] = {
        rotation.x(), rotation.y(), rotation.z(), rotation.w()};
  }
  return {{"name", fs::path(folder).filename().string()},
          {"num_images", model.images.size()},
          {"num_points", model.num_points},
          {"num_observations", model.num_observations},
          {"median_error_px", model.median_error_px},
          {"error_step_px", kErrorStepPx},
          {"error_histogram", model.error_histogram},
          {"track_histogram", model.track_histogram},
          {"cameras", CameraEntries(model)},
          {"points", PointEntries(model, origin, index_of_image)}};
}

void AddThumbnails(const ReportPageInput& input,
                   const std::vector<std::string>& names,
                   Json* image_entries) {
  if (input.image_path.empty()) return;
  const std::vector<std::string> thumbnails = MakeThumbnails(
      input.image_path, names, kMaxThumbnailBytes, input.num_threads);
  for (size_t i = 0; i < names.size(); ++i) {
    if (thumbnails[i].empty()) continue;
    (*image_entries)[i]["thumbnail"] = ToBase64(thumbnails[i]);
  }
}

// "2" comes before "10".
std::vector<std::string> InOrderOfNumbers(std::vector<std::string> folders) {
  std::stable_sort(folders.begin(),
                   folders.end(),
                   [](const std::string& a, const std::string& b) {
                     return a.size() < b.size();
                   });
  return folders;
}

}  // namespace

Json ReportPageData(const ReportPageInput& input) {
  const std::vector<std::string> folders =
      InOrderOfNumbers(input.model_folders);
  const MapperResults results =
      ReadMapperResults(input.report_path, input.project_path);
  // The images' own names by those that JSON has for them.
  std::map<std::string, std::string> names;
  for (const Json& image : results.images) {
    names[image.at("name")] = image.at("name");
  }
  for (const std::string& name : results.pair_image_names) names[name] = name;
  std::vector<ModelSummary> models;
  for (const std::string& folder : folders) {
    models.push_back(SummarizeModel(
        folder, kMaxNumPoints / folders.size(), kMaxNumViews / folders.size()));
    for (const auto& [name, image] : models.back().images) {
      names[PrintableName(name)] = name;
    }
  }

  ImageIndices indices;
  std::vector<std::string> own_names;
  Json image_entries = Json::array();
  for (const auto& [printable, name] : names) {
    indices.emplace(printable, uint32_t(indices.size()));
    image_entries.push_back({{"name", printable}});
    own_names.push_back(name);
  }
  for (const Json& image : results.images) {
    image_entries[indices.at(image.at("name"))].update(image);
  }
  AddThumbnails(input, own_names, &image_entries);
  Json model_entries = Json::array();
  for (size_t i = 0; i < models.size(); ++i) {
    model_entries.push_back(
        ModelEntry(folders[i], i, models[i], indices, &image_entries));
  }
  return {{"title", input.title},
          {"report", results.report},
          {"options", results.options},
          {"images", std::move(image_entries)},
          {"models", std::move(model_entries)},
          {"pairs", PairArrays(results, indices)}};
}

void WriteReportPage(const ReportPageInput& input, const std::string& path) {
  std::string data = JsonText(ReportPageData(input), -1);
  // A name of an image must not end the element that holds the data.
  boost::algorithm::replace_all(data, "<", "\\u003c");
  std::string page = kReportPageTemplate;
  page.replace(page.find(kReportDataMark), sizeof(kReportDataMark) - 1, data);
  WriteFile(path, page);
}

}  // namespace dgsfm
