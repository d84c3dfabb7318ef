#include "controllers/report/mapper_results.h"

#include "controllers/commands/command_options.h"
#include "controllers/global_depth_mapper_options.h"
#include "controllers/output_folder.h"
#include "controllers/report/base64.h"

#include <algorithm>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <vector>

namespace dgsfm {
namespace {

using Json = nlohmann::ordered_json;

// Checks what this layer reads itself; the page copes with the rest.
void CheckEntries(const Json& report) {
  for (const Json& image : report.at("images")) {
    image.at("name").get_ref<const std::string&>();
  }
  for (const Json& pair : report.at("view_graph")) {
    for (const char* key : {"image1", "image2", "status"}) {
      pair.at(key).get_ref<const std::string&>();
    }
    for (const char* key : {"num_matches", "num_inliers"}) {
      pair.at(key).get<uint32_t>();
    }
  }
}

Json ReadReport(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path);
  try {
    Json report = Json::parse(file);
    CheckEntries(report);
    return report;
  } catch (const Json::exception& error) {
    throw std::runtime_error(
        path + " is no report of depth_global_mapper: " + error.what());
  }
}

// Values of the lines "name=value", after a line [Group] as "Group.name".
std::vector<std::pair<std::string, std::string>> ProjectValues(
    std::istream& lines) {
  std::vector<std::pair<std::string, std::string>> values;
  std::string prefix;
  for (std::string line; std::getline(lines, line);) {
    const size_t equals = line.find('=');
    if (line.size() > 2 && line.front() == '[' && line.back() == ']') {
      prefix = line.substr(1, line.size() - 2) + ".";
    } else if (equals != std::string::npos) {
      values.emplace_back(prefix + line.substr(0, equals),
                          line.substr(equals + 1));
    }
  }
  return values;
}

Json ReadOptions(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read " + path);
  GlobalDepthMapperOptions options;
  CommandOptions command_options("", "");
  BindOptions(&options, &command_options);
  std::istringstream default_lines(command_options.ProjectText());
  std::map<std::string, std::string> defaults;
  for (const auto& [name, value] : ProjectValues(default_lines)) {
    defaults[name] = value;
  }
  Json entries = Json::array();
  for (const auto& [name, value] : ProjectValues(file)) {
    Json entry = {{"name", name}, {"value", value}};
    const auto found = defaults.find(name);
    if (found != defaults.end()) entry["default"] = found->second;
    entries.push_back(entry);
  }
  return entries;
}

}  // namespace

MapperResults ReadMapperResults(const std::string& report_path,
                                const std::string& project_path) {
  MapperResults results;
  if (!report_path.empty()) {
    results.report = ReadReport(report_path);
    results.images = std::move(results.report["images"]);
    results.pairs = std::move(results.report["view_graph"]);
    results.report.erase("images");
    results.report.erase("view_graph");
  }
  if (!project_path.empty()) results.options = ReadOptions(project_path);
  return results;
}

std::string PrintableName(const std::string& name) {
  return Json::parse(JsonText(Json(name), -1)).get<std::string>();
}

Json PairArrays(const MapperResults& results,
                const std::map<std::string, uint32_t>& image_indices) {
  std::vector<std::string> names;
  std::vector<uint32_t> images, num_matches, num_inliers;
  std::vector<uint8_t> statuses;
  for (const Json& pair : results.pairs) {
    const std::string& status = pair.at("status").get_ref<const std::string&>();
    auto found = std::find(names.begin(), names.end(), status);
    if (found == names.end()) found = names.insert(names.end(), status);
    const auto image1 = image_indices.find(pair.at("image1"));
    const auto image2 = image_indices.find(pair.at("image2"));
    if (image1 == image_indices.end() || image2 == image_indices.end())
      continue;
    images.push_back(image1->second);
    images.push_back(image2->second);
    statuses.push_back(uint8_t(found - names.begin()));
    num_matches.push_back(pair.at("num_matches"));
    num_inliers.push_back(pair.at("num_inliers"));
  }
  return {{"count", statuses.size()},
          {"status_names", names},
          {"images", ToBase64(images)},
          {"statuses", ToBase64(statuses)},
          {"num_matches", ToBase64(num_matches)},
          {"num_inliers", ToBase64(num_inliers)}};
}

}  // namespace dgsfm
