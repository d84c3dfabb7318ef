// What depth_global_mapper left beside its models, for the report page.

#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace dgsfm {

struct MapperResults {
  // A pair of the view graph; images and status are indices of the names below.
  struct Pair {
    uint32_t image1 = 0;
    uint32_t image2 = 0;
    uint32_t status = 0;
    uint32_t num_matches = 0;
    uint32_t num_inliers = 0;
  };

  // report.json without "images" and "view_graph"; null without the file.
  nlohmann::ordered_json report;
  // The entries of "images".
  nlohmann::ordered_json images = nlohmann::ordered_json::array();
  // In the order of "view_graph". Names are in the order of appearance.
  std::vector<Pair> pairs;
  std::vector<std::string> pair_image_names;
  std::vector<std::string> status_names;
  // {"name", "value", "default"} of each option of project.ini.
  nlohmann::ordered_json options = nlohmann::ordered_json::array();
};

// Results without those of a file whose path is empty. Throws
// std::runtime_error naming a file that cannot be read or has another format.
MapperResults ReadMapperResults(const std::string& report_path,
                                const std::string& project_path);

// A name as JSON has it: bytes that are no UTF-8 are U+FFFD.
std::string PrintableName(const std::string& name);

// The image indices have all names of the pairs. Names of the statuses, and for
// each pair the indices of its images and of its status, and the numbers of its
// matches and inliers, as arrays in base64.
nlohmann::ordered_json PairArrays(
    const MapperResults& results,
    const std::map<std::string, uint32_t>& image_indices);

}  // namespace dgsfm
