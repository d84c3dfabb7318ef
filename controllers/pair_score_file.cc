#include "controllers/pair_score_file.h"

#include "controllers/image_names.h"

#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <stdexcept>
#include <vector>

#include <boost/algorithm/string.hpp>
#include <boost/lexical_cast/try_lexical_convert.hpp>
#include <boost/tokenizer.hpp>
#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

namespace ba = boost::algorithm;

constexpr char kSeparator[] = "<>";
// That some programs begin UTF-8 with.
constexpr char kByteOrderMark[] = "\xef\xbb\xbf";

struct Entry {
  std::string name1;
  std::string name2;
  double score = -1;
};

std::vector<std::string> SplitAtSeparator(const std::string& text) {
  std::vector<std::string> parts;
  ba::iter_split(parts, text, ba::first_finder(kSeparator));
  for (std::string& part : parts) ba::trim(part);
  return parts;
}

std::optional<Entry> CreateEntry(const std::vector<std::string>& fields) {
  Entry entry;
  if (fields.size() != 3 || fields[0].empty() || fields[1].empty() ||
      !boost::conversion::try_lexical_convert(fields[2], entry.score)) {
    return std::nullopt;
  }
  entry.name1 = fields[0];
  entry.name2 = fields[1];
  return entry;
}

std::optional<Entry> ParseLine(const std::string& line) {
  std::vector<std::string> fields = SplitAtSeparator(line);
  if (fields.size() == 1) {
    ba::split(fields, line, ba::is_space(), ba::token_compress_on);
  }
  // The score may stand behind a space.
  const size_t space = fields.back().find_last_of(" \t");
  if (fields.size() == 2 && space != std::string::npos) {
    const std::string last = fields.back();
    fields.back() = ba::trim_copy(last.substr(0, space));
    fields.push_back(last.substr(space + 1));
  }
  return CreateEntry(fields);
}

std::optional<Entry> ParseCsvLine(const std::string& line) {
  // Fields may be in quotes; no character escapes another.
  const boost::escaped_list_separator<char> separator("", ",", "\"");
  const boost::tokenizer tokenizer(line, separator);
  std::vector<std::string> fields(tokenizer.begin(), tokenizer.end());
  for (std::string& field : fields) ba::trim(field);
  return CreateEntry(fields);
}

// An entry of a list of JSON. Throws unless it has the names and the score.
Entry ParseItem(const nlohmann::json& item) {
  if (item.is_object()) {
    return {item.at("image1"), item.at("image2"), item.at("score")};
  }
  if (item.size() != 3) throw std::runtime_error("not three values");
  return {item.at(0), item.at(1), item.at(2)};
}

// Collects entries; errors name the place in the file.
class ScoreCollector {
 public:
  explicit ScoreCollector(const Scene& scene)
      : image_ids_(ImageIdsByName(scene, /*with_flat_names=*/false)) {}

  void Add(const std::string& place, const std::optional<Entry>& entry) {
    const auto fail = [&](const std::string& problem) {
      throw std::runtime_error(place + ": " + problem);
    };
    if (!entry) fail("expected two image names and a score");
    if (!(entry->score >= 0 && entry->score <= 1)) {
      fail("score is not in [0, 1]");
    }
    const colmap::image_t image_id1 = FindImage(place, entry->name1);
    const colmap::image_t image_id2 = FindImage(place, entry->name2);
    if (image_id1 == image_id2) fail("both names are " + entry->name1);
    const auto [it, is_new] =
        scores_.emplace(PairIdOfImages(image_id1, image_id2), entry->score);
    // Both directions of a pair may be listed, with the same score.
    if (!is_new && it->second != entry->score) {
      fail("the pair has another score before");
    }
  }

  PairScores Take() { return std::move(scores_); }

 private:
  colmap::image_t FindImage(const std::string& place,
                            const std::string& name) const {
    const auto image = image_ids_.find(name);
    if (image == image_ids_.end()) {
      throw std::runtime_error(place + ": image " + name +
                               " is not in the database");
    }
    if (image->second == colmap::kInvalidImageId) {
      throw std::runtime_error(place + ": image " + name +
                               " is in several folders");
    }
    return image->second;
  }

  const std::map<std::string, colmap::image_t> image_ids_;
  PairScores scores_;
};

void ReadJson(const std::string& path,
              std::ifstream* file,
              ScoreCollector* collector) {
  using nlohmann::json;
  const json root = json::parse(*file, nullptr, /*allow_exceptions=*/false);
  if (!root.is_object() && !root.is_array()) {
    throw std::runtime_error(path + ": neither an object nor a list of JSON");
  }
  for (const auto& [key, value] : root.items()) {
    std::optional<Entry> entry;
    try {
      if (root.is_array()) {
        entry = ParseItem(value);
      } else {
        const std::vector<std::string> names = SplitAtSeparator(key);
        if (names.size() == 2) entry = Entry{names[0], names[1], value};
      }
    } catch (const std::exception&) {
      // Reported with its place.
    }
    collector->Add(path + ", entry " + key, entry);
  }
}

void ReadLines(const std::string& path,
               bool is_csv,
               std::ifstream* file,
               ScoreCollector* collector) {
  std::string line;
  for (size_t number = 1; std::getline(*file, line); ++number) {
    if (number == 1 && line.rfind(kByteOrderMark, 0) == 0) {
      line.erase(0, std::strlen(kByteOrderMark));
    }
    ba::trim(line);
    if (line.empty() || line[0] == '#') continue;
    const auto entry = is_csv ? ParseCsvLine(line) : ParseLine(line);
    // Titles are recognised by having no number in the third column.
    const bool is_title = is_csv && number == 1 && !entry;
    if (!is_title) collector->Add(path + ":" + std::to_string(number), entry);
  }
}

}  // namespace

PairScores ReadPairScores(const std::string& path, const Scene& scene) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read pair scores from " + path);
  ScoreCollector collector(scene);
  const std::string extension = std::filesystem::path(path).extension();
  if (extension == ".json") {
    ReadJson(path, &file, &collector);
  } else {
    ReadLines(path, extension == ".csv", &file, &collector);
  }
  return collector.Take();
}

}  // namespace dgsfm
