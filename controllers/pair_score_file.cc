#include "controllers/pair_score_file.h"

#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>

namespace dgsfm {

PairScores ReadPairScores(const std::string& path, const Scene& scene) {
  std::map<std::string, colmap::image_t> image_ids;
  for (const auto& [image_id, image] : scene.images) {
    image_ids[image.Name()] = image_id;
  }
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read pair scores from " + path);
  PairScores scores;
  std::string line;
  for (size_t number = 1; std::getline(file, line); ++number) {
    const auto fail = [&](const std::string& problem) {
      throw std::runtime_error(path + ":" + std::to_string(number) + ": " +
                               problem);
    };
    const size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    std::istringstream fields(line);
    std::string name1;
    std::string name2;
    double score = -1;
    std::string rest;
    if (!(fields >> name1 >> name2 >> score) || (fields >> rest)) {
      fail("expected 'name1 name2 score'");
    }
    if (!(score >= 0 && score <= 1)) fail("score is not in [0, 1]");
    for (const std::string& name : {name1, name2}) {
      if (image_ids.count(name) == 0) {
        fail("image " + name + " is not in the database");
      }
    }
    if (name1 == name2) fail("both names are " + name1);
    const colmap::image_pair_t pair_id =
        PairIdOfImages(image_ids[name1], image_ids[name2]);
    const auto [it, is_new] = scores.emplace(pair_id, score);
    if (!is_new && it->second != score) {
      fail("the pair has another score before");
    }
  }
  return scores;
}

}  // namespace dgsfm
