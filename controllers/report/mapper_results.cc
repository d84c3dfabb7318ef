#include "controllers/report/mapper_results.h"

#include "controllers/commands/command_options.h"
#include "controllers/global_depth_mapper_options.h"
#include "controllers/output_folder.h"
#include "controllers/report/base64.h"

#include <fstream>
#include <sstream>
#include <stdexcept>
#include <unordered_map>
#include <utility>

namespace dgsfm {
namespace {

using Json = nlohmann::ordered_json;

// Indices of names in the order in which they appear.
class NameIndices {
 public:
  explicit NameIndices(std::vector<std::string>* names) : names_(names) {}

  uint32_t Of(const std::string& name) {
    const auto [found, is_new] =
        indices_.emplace(name, uint32_t(names_->size()));
    if (is_new) names_->push_back(name);
    return found->second;
  }

 private:
  std::unordered_map<std::string, uint32_t> indices_;
  std::vector<std::string>* names_;
};

// Reads report.json. Its pairs, of which there may be a million, are taken out
// one by one while the file is read. Throws Json::exception.
void ReadReport(std::istream& file, MapperResults* results) {
  NameIndices images(&results->pair_image_names);
  NameIndices statuses(&results->status_names);
  std::string key;
  const auto take_pair =
      [&](int depth, Json::parse_event_t event, Json& parsed) {
        if (depth == 1 && event == Json::parse_event_t::key) {
          key = parsed.get<std::string>();
        }
        const bool is_pair = depth == 2 && key == "view_graph" &&
                             event == Json::parse_event_t::object_end;
        if (is_pair) {
          results->pairs.push_back({images.Of(parsed.at("image1")),
                                    images.Of(parsed.at("image2")),
                                    statuses.Of(parsed.at("status")),
                                    parsed.at("num_matches"),
                                    parsed.at("num_inliers")});
        }
        return !is_pair;
      };
  results->report = Json::parse(file, take_pair);
  results->images = results->report.at("images");
  for (const Json& image : results->images) {
    image.at("name").get_ref<const std::string&>();
  }
  results->report.at("view_graph");
  results->report.erase("images");
  results->report.erase("view_graph");
}

void ReadReport(const std::string& path, MapperResults* results) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path);
  try {
    ReadReport(file, results);
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
  if (!report_path.empty()) ReadReport(report_path, &results);
  if (!project_path.empty()) results.options = ReadOptions(project_path);
  return results;
}

std::string PrintableName(const std::string& name) {
  return Json::parse(JsonText(Json(name), -1)).get<std::string>();
}

Json PairArrays(const MapperResults& results,
                const std::map<std::string, uint32_t>& image_indices) {
  std::vector<uint32_t> images, num_matches, num_inliers;
  std::vector<uint8_t> statuses;
  for (const MapperResults::Pair& pair : results.pairs) {
    for (const uint32_t image : {pair.image1, pair.image2}) {
      images.push_back(image_indices.at(results.pair_image_names[image]));
    }
    statuses.push_back(uint8_t(pair.status));
    num_matches.push_back(pair.num_matches);
    num_inliers.push_back(pair.num_inliers);
  }
  return {{"count", statuses.size()},
          {"status_names", results.status_names},
          {"images", ToBase64(images)},
          {"statuses", ToBase64(statuses)},
          {"num_matches", ToBase64(num_matches)},
          {"num_inliers", ToBase64(num_inliers)}};
}

}  // namespace dgsfm
