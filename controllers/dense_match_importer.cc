#include "controllers/dense_match_importer.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/keypoint_merger.h"
#include "colmap_ext/progress.h"
#include "controllers/image_names.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace dgsfm {
namespace {

constexpr char kDeleteMatches[] = R"(
DELETE FROM matches;
DELETE FROM two_view_geometries;
DELETE FROM keypoints;
DELETE FROM descriptors;
)";

// Indices of key points between the images' turns, outside of the database.
constexpr char kCreateIndexTable[] = R"(
CREATE TEMP TABLE dense_match_indices (
  pair_id INTEGER NOT NULL, image_id INTEGER NOT NULL, data BLOB NOT NULL,
  PRIMARY KEY (pair_id, image_id));
)";

// The images that the names of groups stand for.
class PairNames {
 public:
  explicit PairNames(const Scene& scene)
      : image_ids_(ImageIdsByName(scene, /*with_flat_names=*/true)) {}

  // In the order of the name; nothing unless there is exactly one way to read
  // it.
  std::optional<std::pair<colmap::image_t, colmap::image_t>> Find(
      const std::string& group) const {
    std::optional<std::pair<colmap::image_t, colmap::image_t>> found;
    for (const std::string separator : {"<>", "_", "-", "/"}) {
      for (size_t pos = group.find(separator); pos != std::string::npos;
           pos = group.find(separator, pos + 1)) {
        const auto image1 = image_ids_.find(group.substr(0, pos));
        const auto image2 =
            image_ids_.find(group.substr(pos + separator.size()));
        if (image1 == image_ids_.end() || image2 == image_ids_.end() ||
            image1->second == image2->second ||
            image1->second == colmap::kInvalidImageId ||
            image2->second == colmap::kInvalidImageId) {
          continue;
        }
        const auto pair = std::make_pair(image1->second, image2->second);
        // "a-b-c" may be a and b-c, or a-b and c.
        if (found && *found != pair) return std::nullopt;
        found = pair;
      }
    }
    return found;
  }

 private:
  const std::map<std::string, colmap::image_t> image_ids_;
};

struct PairSource {
  std::string group;
  // Whether the first points are of the image of the larger id.
  bool is_swapped = false;
};

// Writes into an open transaction.
class DenseMatchImport {
 public:
  DenseMatchImport(const Scene& scene,
                   const DenseMatchFile& file,
                   const DenseMatchImportOptions& options,
                   const SqliteConnection& connection)
      : scene_(scene),
        file_(file),
        options_(options),
        connection_(connection),
        insert_indices_(connection,
                        "INSERT INTO temp.dense_match_indices VALUES(?, ?, ?)"),
        select_indices_(connection,
                        "SELECT data FROM temp.dense_match_indices "
                        "WHERE pair_id = ? AND image_id = ?") {}

  DenseMatchImportSummary Run() {
    FindPairs();
    Progress progress("Importing dense matches",
                      pairs_of_image_.size() + pairs_.size());
    for (const auto& [image_id, pair_ids] : pairs_of_image_) {
      WriteKeypoints(image_id, pair_ids);
      progress.Step();
    }
    for (const auto& [pair_id, source] : pairs_) {
      WriteMatches(pair_id);
      progress.Step();
    }
    summary_.num_pairs = pairs_.size();
    for (const auto& [group, num_left_out] : num_left_out_) {
      summary_.num_matches_left_out += num_left_out;
    }
    CheckIsAny();
    return std::move(summary_);
  }

 private:
  void FindPairs() {
    const PairNames names(scene_);
    for (const std::string& group : file_.Groups()) {
      const auto images = names.Find(group);
      if (!images) {
        summary_.groups_without_images.push_back(group);
        continue;
      }
      const auto [image_id1, image_id2] = *images;
      const colmap::image_pair_t pair_id = PairIdOfImages(image_id1, image_id2);
      pairs_[pair_id].push_back({group, image_id1 > image_id2});
    }
    for (const auto& [pair_id, sources] : pairs_) {
      const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
      pairs_of_image_[image_id1].push_back(pair_id);
      pairs_of_image_[image_id2].push_back(pair_id);
    }
    if (pairs_.empty()) {
      throw std::runtime_error(
          file_.Path() +
          ": no group is called after two images of the database" +
          (file_.Groups().empty() ? "" : ", such as " + file_.Groups()[0]));
    }
  }

  // Points outside come from padding that some matchers add to images.
  bool IsInside(const Eigen::Vector2f& point, colmap::image_t image_id) const {
    const colmap::Camera& camera =
        scene_.cameras.at(scene_.images.at(image_id).CameraId());
    return point.x() >= 0 && point.x() <= camera.Width() && point.y() >= 0 &&
           point.y() <= camera.Height();
  }

  // The matches that are kept, the first points those of the smaller id.
  DenseMatches ReadSource(colmap::image_pair_t pair_id,
                          const PairSource& source) {
    DenseMatches all = file_.Read(source.group);
    if (source.is_swapped) std::swap(all.points1, all.points2);
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const Eigen::Vector2f offset =
        Eigen::Vector2f::Constant(options_.coordinate_offset_px);
    DenseMatches kept;
    for (size_t i = 0; i < all.points1.size(); ++i) {
      for (const auto& point : {all.points1[i], all.points2[i]}) {
        has_pixels_ |= (point.array().abs() > 1).any();
      }
      const Eigen::Vector2f point1 = all.points1[i] + offset;
      const Eigen::Vector2f point2 = all.points2[i] + offset;
      const bool is_confident = all.confidences.empty() ||
                                all.confidences[i] >= options_.min_confidence;
      if (!is_confident || !IsInside(point1, image_id1) ||
          !IsInside(point2, image_id2)) {
        continue;
      }
      kept.points1.push_back(point1);
      kept.points2.push_back(point2);
    }
    // Assigned, not added: each pair is read once for either image.
    num_left_out_[source.group] = all.points1.size() - kept.points1.size();
    return kept;
  }

  void WriteKeypoints(colmap::image_t image_id,
                      const std::vector<colmap::image_pair_t>& pair_ids) {
    KeypointMerger merger(options_.merge_radius_px);
    for (const colmap::image_pair_t pair_id : pair_ids) {
      const bool is_first = ImageIdsOfPair(pair_id).first == image_id;
      std::vector<uint32_t> indices;
      for (const PairSource& source : pairs_.at(pair_id)) {
        const DenseMatches matches = ReadSource(pair_id, source);
        const auto& points = is_first ? matches.points1 : matches.points2;
        summary_.num_points += points.size();
        const std::vector<uint32_t> added = merger.AddPair(points);
        indices.insert(indices.end(), added.begin(), added.end());
      }
      insert_indices_.Bind(pair_id, image_id, indices).Run();
    }
    std::vector<float> data;
    data.reserve(2 * merger.Keypoints().size());
    for (const Eigen::Vector2f& keypoint : merger.Keypoints()) {
      data.push_back(keypoint.x());
      data.push_back(keypoint.y());
    }
    summary_.num_keypoints += merger.Keypoints().size();
    SqliteStatement(connection_,
                    "INSERT INTO keypoints(image_id, rows, cols, data) "
                    "VALUES(?, ?, 2, ?)")
        .Bind(image_id, merger.Keypoints().size(), data)
        .Run();
  }

  std::vector<uint32_t> ReadIndices(colmap::image_pair_t pair_id,
                                    colmap::image_t image_id) {
    select_indices_.Bind(pair_id, image_id);
    std::vector<uint32_t> indices;
    if (select_indices_.Step()) indices = select_indices_.Blob<uint32_t>(0);
    select_indices_.Reset();
    return indices;
  }

  void WriteMatches(colmap::image_pair_t pair_id) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const std::vector<uint32_t> indices1 = ReadIndices(pair_id, image_id1);
    const std::vector<uint32_t> indices2 = ReadIndices(pair_id, image_id2);
    // The file may change while it is read.
    if (indices1.size() != indices2.size()) {
      throw std::runtime_error(file_.Path() + ": pair " +
                               pairs_.at(pair_id).front().group +
                               " changed during the import");
    }
    // Both directions of a pair have many matches in common.
    std::set<std::pair<uint32_t, uint32_t>> known;
    const bool may_repeat = pairs_.at(pair_id).size() > 1;
    std::vector<uint32_t> data;
    data.reserve(2 * indices1.size());
    for (size_t i = 0; i < indices1.size(); ++i) {
      if (may_repeat && !known.emplace(indices1[i], indices2[i]).second) {
        continue;
      }
      data.push_back(indices1[i]);
      data.push_back(indices2[i]);
    }
    const size_t num_matches = data.size() / 2;
    summary_.num_matches += num_matches;
    SqliteStatement(connection_,
                    "INSERT INTO matches(pair_id, rows, cols, data) "
                    "VALUES(?, ?, 2, ?)")
        .Bind(pair_id, num_matches, data)
        .Run();
  }

  // Writing nothing would look like success.
  void CheckIsAny() const {
    const size_t num_read =
        summary_.num_matches + summary_.num_matches_left_out;
    if (num_read > 0 && !has_pixels_) {
      throw std::runtime_error(
          file_.Path() +
          ": all points are within one pixel of the corner of their images; "
          "coordinates have to be pixels, not shares of the size");
    }
    if (summary_.num_matches > 0) return;
    throw std::runtime_error(
        file_.Path() + ": no match is imported: " +
        (num_read == 0 ? "the file has none"
                       : "all " + std::to_string(num_read) +
                             " are outside of their images or below "
                             "min_confidence") +
        ", in pairs such as " + pairs_.begin()->second.front().group);
  }

  const Scene& scene_;
  const DenseMatchFile& file_;
  const DenseMatchImportOptions& options_;
  const SqliteConnection& connection_;
  SqliteStatement insert_indices_;
  SqliteStatement select_indices_;
  // Both directions of a pair, or one.
  std::map<colmap::image_pair_t, std::vector<PairSource>> pairs_;
  std::map<colmap::image_t, std::vector<colmap::image_pair_t>> pairs_of_image_;
  std::map<std::string, size_t> num_left_out_;  // by group
  // Whether a coordinate is beyond a share of the size.
  bool has_pixels_ = false;
  DenseMatchImportSummary summary_;
};

void CheckIsEmpty(const SqliteConnection& connection) {
  for (const char* table : {"keypoints", "matches"}) {
    SqliteStatement count(
        connection,
        std::string("SELECT count(*) FROM ") + table + " WHERE rows > 0");
    count.Step();
    if (count.Int(0) == 0) continue;
    throw connection.Error()
        << "has " << table << " of " << count.Int(0) << " "
        << (std::string(table) == "keypoints" ? "images" : "pairs")
        << "; import into a database of images alone, or use --overwrite 1, "
           "which replaces features and matches";
  }
}

}  // namespace

bool DenseMatchImportOptions::IsValid(std::string* error) const {
  // Beyond a pixel, points would be moved, not merged.
  if (!(merge_radius_px >= 0 && merge_radius_px <= 1)) {
    *error = "merge_radius must be in [0, 1]";
    return false;
  }
  if (!std::isfinite(coordinate_offset_px) || std::isnan(min_confidence)) {
    *error = "coordinate_offset and min_confidence must be numbers";
    return false;
  }
  return true;
}

std::string DenseMatchImportSummary::ToText() const {
  std::ostringstream text;
  for (const std::string& group : groups_without_images) {
    text << "group without images: " << group << "\n";
  }
  text << "imported " << num_matches << " matches of " << num_pairs
       << " pairs, " << num_points << " points merged into " << num_keypoints
       << " key points, " << num_matches_left_out << " matches left out\n";
  return text.str();
}

DenseMatchImportSummary ImportDenseMatches(
    const std::string& database_path,
    const DenseMatchFile& file,
    const DenseMatchImportOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const Scene scene = ReadScene(database_path, SceneContent::IMAGES);
  const SqliteConnection connection(database_path,
                                    SqliteConnection::Mode::READ_WRITE);
  connection.Execute(kCreateIndexTable);
  SqliteTransaction transaction(connection, SqliteTransaction::Kind::WRITE);
  if (!options.overwrite) CheckIsEmpty(connection);
  connection.Execute(kDeleteMatches);
  const DenseMatchImportSummary summary =
      DenseMatchImport(scene, file, options, connection).Run();
  transaction.Commit();
  return summary;
}

}  // namespace dgsfm
