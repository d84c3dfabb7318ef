#include "controllers/pair_score_file.h"

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <stdexcept>
#include <vector>

#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

constexpr char kSeparator[] = "<>";
constexpr char kSpaces[] = " \t\r";
// That some programs begin UTF-8 with.
constexpr char kByteOrderMark[] = "\xef\xbb\xbf";

struct Entry {
  std::string name1;
  std::string name2;
  double score = -1;
};

std::string Trim(const std::string& text) {
  const size_t begin = text.find_first_not_of(kSpaces);
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(kSpaces) + 1 - begin);
}

// Splits behind every separator; no part is left out.
std::vector<std::string> Split(const std::string& text,
                               const std::string& separator) {
  std::vector<std::string> parts;
  size_t begin = 0;
  for (size_t end = text.find(separator); end != std::string::npos;
       end = text.find(separator, begin)) {
    parts.push_back(Trim(text.substr(begin, end - begin)));
    begin = end + separator.size();
  }
  parts.push_back(Trim(text.substr(begin)));
  return parts;
}

std::optional<double> ParseScore(const std::string& text) {
  char* end = nullptr;
  const double score = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') return std::nullopt;
  return score;
}

std::optional<Entry> CreateEntry(const std::vector<std::string>& fields) {
  if (fields.size() != 3) return std::nullopt;
  const auto score = ParseScore(fields[2]);
  if (!score || fields[0].empty() || fields[1].empty()) return std::nullopt;
  return Entry{fields[0], fields[1], *score};
}

std::optional<Entry> ParseLine(const std::string& line) {
  if (line.find(kSeparator) == std::string::npos) {
    std::vector<std::string> fields;
    for (const std::string& field : Split(line, " ")) {
      for (const std::string& part : Split(field, "\t")) {
        if (!part.empty()) fields.push_back(part);
      }
    }
    return CreateEntry(fields);
  }
  std::vector<std::string> fields = Split(line, kSeparator);
  // The score may stand behind a space.
  const size_t space = fields.back().find_last_of(kSpaces);
  if (fields.size() == 2 && space != std::string::npos) {
    const std::string last = fields.back();
    fields.back() = Trim(last.substr(0, space));
    fields.push_back(last.substr(space + 1));
  }
  return CreateEntry(fields);
}

std::vector<std::string> SplitCsv(const std::string& line) {
  std::vector<std::string> fields(1);
  bool is_quoted = false;
  for (const char c : line) {
    if (c == '"') {
      is_quoted = !is_quoted;
    } else if (c == ',' && !is_quoted) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  for (std::string& field : fields) field = Trim(field);
  return fields;
}

// Collects entries; errors name the place in the file.
class ScoreCollector {
 public:
  explicit ScoreCollector(const Scene& scene) {
    for (const auto& [image_id, image] : scene.images) {
      image_ids_[image.Name()] = image_id;
      const std::string base_name =
          std::filesystem::path(image.Name()).filename();
      const auto [it, is_new] = base_ids_.emplace(base_name, image_id);
      if (!is_new) it->second = colmap::kInvalidImageId;
    }
  }

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
    if (!is_new && it->second != entry->score) {
      fail("the pair has another score before");
    }
  }

  PairScores Take() { return std::move(scores_); }

 private:
  colmap::image_t FindImage(const std::string& place,
                            const std::string& name) const {
    const auto image = image_ids_.find(name);
    if (image != image_ids_.end()) return image->second;
    const auto base = base_ids_.find(name);
    if (base == base_ids_.end()) {
      throw std::runtime_error(place + ": image " + name +
                               " is not in the database");
    }
    if (base->second == colmap::kInvalidImageId) {
      throw std::runtime_error(place + ": image " + name +
                               " is in several folders");
    }
    return base->second;
  }

  std::map<std::string, colmap::image_t> image_ids_;
  // Without folders; kInvalidImageId where several images have the name.
  std::map<std::string, colmap::image_t> base_ids_;
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
    if (root.is_object()) {
      const std::vector<std::string> names = Split(key, kSeparator);
      if (names.size() == 2 && value.is_number()) {
        entry = Entry{names[0], names[1], value.get<double>()};
      }
    } else if (value.is_array() && value.size() == 3 && value[0].is_string() &&
               value[1].is_string() && value[2].is_number()) {
      entry = Entry{value[0], value[1], value[2]};
    } else if (value.is_object() && value.contains("image1") &&
               value.contains("image2") && value.contains("score") &&
               value["image1"].is_string() && value["image2"].is_string() &&
               value["score"].is_number()) {
      entry = Entry{value["image1"], value["image2"], value["score"]};
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
    line = Trim(line);
    if (line.empty() || line[0] == '#') continue;
    const auto entry = is_csv ? CreateEntry(SplitCsv(line)) : ParseLine(line);
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
