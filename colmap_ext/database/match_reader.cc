#include "colmap_ext/database/match_reader.h"

#include "colmap_ext/database/colmap_schema.h"
#include "colmap_ext/database/keypoint_selection.h"

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

namespace dgsfm {
namespace {

constexpr char kPutative[] = " FROM matches WHERE rows != 0";
constexpr char kVerified[] =
    " FROM two_view_geometries "
    // Calibrated, uncalibrated, planar, panoramic, planar or panoramic,
    // calibrated rig; the others are failures, watermarks and mixtures.
    "WHERE rows != 0 AND config IN (2, 3, 4, 5, 6, 9)";
// Columns are named, as later versions of COLMAP have others besides.
const std::string kSelectRow = "SELECT pair_id, rows, cols, data";

bool IsLess(const colmap::FeatureMatch& a, const colmap::FeatureMatch& b) {
  return a.point2D_idx1 != b.point2D_idx1 ? a.point2D_idx1 < b.point2D_idx1
                                          : a.point2D_idx2 < b.point2D_idx2;
}

// Whether no key point of image 1 has two matches: then there are no equal
// ones.
bool HaveDistinctFirstPoints(const colmap::FeatureMatches& matches) {
  colmap::point2D_t num_keypoints = 0;
  for (const colmap::FeatureMatch& match : matches) {
    num_keypoints = std::max(num_keypoints, match.point2D_idx1 + 1);
  }
  std::vector<bool> is_matched(num_keypoints, false);
  for (const colmap::FeatureMatch& match : matches) {
    if (is_matched[match.point2D_idx1]) return false;
    is_matched[match.point2D_idx1] = true;
  }
  return true;
}

// Keeps the first of equal matches and the order.
void RemoveDuplicates(colmap::FeatureMatches* matches) {
  const auto is_not_less = [](const auto& a, const auto& b) {
    return !IsLess(a, b);
  };
  // COLMAP writes matches in ascending order: nothing to do, usually.
  if (std::adjacent_find(matches->begin(), matches->end(), is_not_less) ==
      matches->end()) {
    return;
  }
  if (HaveDistinctFirstPoints(*matches)) return;
  colmap::FeatureMatches sorted = *matches;
  std::sort(sorted.begin(), sorted.end(), IsLess);
  if (std::adjacent_find(sorted.begin(), sorted.end(), is_not_less) ==
      sorted.end()) {
    return;
  }
  std::set<std::pair<colmap::point2D_t, colmap::point2D_t>> seen;
  const auto is_duplicate = [&seen](const colmap::FeatureMatch& match) {
    return !seen.emplace(match.point2D_idx1, match.point2D_idx2).second;
  };
  matches->erase(std::remove_if(matches->begin(), matches->end(), is_duplicate),
                 matches->end());
}

}  // namespace

MatchReader::MatchReader(const SqliteConnection& connection, const Scene& scene)
    : connection_(connection),
      scene_(scene),
      select_putative_(connection, kSelectRow + kPutative + " AND pair_id = ?"),
      select_verified_(connection,
                       kSelectRow + kVerified + " AND pair_id = ?") {
  // Only rows of images, whose ids are checked: a greater id cut to 32 bits
  // would be that of another image.
  num_keypoints_ = SelectMap<colmap::image_t, int64_t>(
      connection,
      "SELECT image_id, rows FROM keypoints JOIN images USING (image_id)");
  SqliteStatement images(connection, "SELECT image_id FROM images");
  while (images.Step()) {
    const int64_t image_id = images.Int(0);
    if (scene.images.count(static_cast<colmap::image_t>(image_id)) == 0) {
      left_out_images_.insert(image_id);
    }
  }
}

bool MatchReader::IsLeftOut(int64_t pair_id) const {
  constexpr auto kDivisor = static_cast<int64_t>(kMaxNumImages);
  return !left_out_images_.empty() &&
         (left_out_images_.count(pair_id / kDivisor) > 0 ||
          left_out_images_.count(pair_id % kDivisor) > 0);
}

// Putative matches are preferred, as verification without depth may have
// dropped matches that depth confirms.
std::vector<MatchReader::PairSize> MatchReader::ListPairs() const {
  std::vector<PairSize> pairs;
  SqliteStatement select(connection_,
                         std::string("SELECT pair_id, rows") + kPutative +
                             " UNION ALL SELECT pair_id, rows" + kVerified +
                             " AND pair_id NOT IN (SELECT pair_id" + kPutative +
                             ") ORDER BY pair_id");
  while (select.Step()) {
    if (IsLeftOut(select.Int(0))) continue;
    pairs.push_back({CheckedPairId(select.Int(0)),
                     static_cast<size_t>(std::max<int64_t>(0, select.Int(1)))});
  }
  return pairs;
}

colmap::FeatureMatches MatchReader::Read(colmap::image_pair_t pair_id) {
  for (SqliteStatement* select : {&select_putative_, &select_verified_}) {
    // Reset at once, because an open row locks the database.
    select->Bind(pair_id);
    const bool is_found = select->Step();
    colmap::FeatureMatches matches;
    if (is_found) matches = ReadRow(*select);
    select->Reset();
    if (is_found) return matches;
  }
  return {};
}

colmap::image_pair_t MatchReader::CheckedPairId(int64_t pair_id) const {
  constexpr int64_t kMaxPairId = kMaxNumImages * kMaxNumImages;
  if (pair_id < 0 || pair_id >= kMaxPairId) {
    throw connection_.Error() << "pair id " << pair_id << " is out of range";
  }
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  for (const colmap::image_t image_id : {image_id1, image_id2}) {
    if (scene_.images.count(image_id) == 0) {
      throw connection_.Error()
          << "matches of pair " << pair_id << " are between images "
          << image_id1 << " and " << image_id2 << ", but there is no image "
          << image_id << "; match again into a fresh database";
    }
  }
  if (image_id1 >= image_id2) {
    throw connection_.Error()
        << "pair id " << pair_id << " stands for images " << image_id1
        << " and " << image_id2 << ", which are not in ascending order";
  }
  return pair_id;
}

colmap::FeatureMatches MatchReader::ReadRow(const SqliteStatement& row) const {
  const auto [image_id1, image_id2] = ImageIdsOfPair(CheckedPairId(row.Int(0)));
  const colmap::Image& image1 = scene_.images.at(image_id1);
  const colmap::Image& image2 = scene_.images.at(image_id2);
  const std::string pair = "pair " + image1.Name() + " - " + image2.Name();
  const int64_t num_rows = row.Int(1);
  const int64_t num_cols = row.Int(2);
  const std::vector<uint32_t> data = row.Blob<uint32_t>(3);
  if (num_cols != 2 || !IsBlobSize(num_rows, num_cols, data.size())) {
    throw connection_.Error()
        << pair << ": " << num_rows << " x " << num_cols
        << " match values announced, " << data.size() << " stored";
  }
  colmap::FeatureMatches matches(num_rows);
  for (int64_t i = 0; i < num_rows; ++i) {
    matches[i] = colmap::FeatureMatch(data[2 * i], data[2 * i + 1]);
  }
  CheckIndices(pair, image1, matches, [](const colmap::FeatureMatch& match) {
    return match.point2D_idx1;
  });
  CheckIndices(pair, image2, matches, [](const colmap::FeatureMatch& match) {
    return match.point2D_idx2;
  });
  // Duplicates would count twice as evidence of a geometry.
  RemoveDuplicates(&matches);
  return matches;
}

// The usual cause is an extraction that was repeated without matching again.
template <typename Select>
void MatchReader::CheckIndices(const std::string& pair,
                               const colmap::Image& image,
                               const colmap::FeatureMatches& matches,
                               const Select& select) const {
  const int64_t num_keypoints = NumKeypoints(image);
  const auto lacking = std::find_if(
      matches.begin(), matches.end(), [&](const colmap::FeatureMatch& match) {
        return select(match) >= num_keypoints;
      });
  if (lacking == matches.end()) return;
  if (num_keypoints == 0) {
    throw connection_.Error()
        << "image " << image.Name() << " has no key points, but " << pair
        << " has matches; extract and match features again";
  }
  throw connection_.Error()
      << pair << ": a match refers to key point " << select(*lacking) << " of "
      << image.Name() << ", which has " << num_keypoints
      << "; match features again";
}

int64_t MatchReader::NumKeypoints(const colmap::Image& image) const {
  const auto it = num_keypoints_.find(image.ImageId());
  return it == num_keypoints_.end() ? 0 : it->second;
}

StoredMatches::StoredMatches(const std::string& database_path,
                             const Scene& scene)
    : connection_(database_path, SqliteConnection::Mode::READ_ONLY),
      scene_(scene),
      reader_(connection_, scene) {}

colmap::FeatureMatches StoredMatches::Read(colmap::image_pair_t pair_id) const {
  colmap::FeatureMatches matches;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    matches = reader_.Read(pair_id);
  }
  if (!scene_.kept_keypoints.empty()) {
    RestrictMatches(scene_.kept_keypoints, pair_id, &matches);
  }
  return matches;
}

}  // namespace dgsfm
