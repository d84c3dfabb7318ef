#include "colmap_ext/database/keypoint_depth_table.h"

#include "colmap_ext/check.h"
#include "colmap_ext/depth/affine_depth.h"
#include "colmap_ext/fnv_hash.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

bool AreDepths(const KeypointDepths& keypoint_depths) {
  const bool is_affine = IsAffine(keypoint_depths.unit);
  return std::all_of(keypoint_depths.depths.begin(),
                     keypoint_depths.depths.end(),
                     [&](float depth) {
                       return std::isfinite(depth) && (is_affine || depth >= 0);
                     });
}

bool IsFocalLength(double focal_length_px) {
  return std::isfinite(focal_length_px) && focal_length_px >= 0;
}

}  // namespace

// The join with images leaves out samples of images that were deleted by a
// program that does not enforce foreign keys.
const char kSelectKeypointDepths[] =
    "SELECT images.image_id, name, coalesce(keypoints.rows, 0), unit, "
    "depths.rows, depths.data, focal_length, keypoints_fingerprint, "
    "source_fingerprint, keypoints.data FROM dgsfm_keypoint_depths AS depths "
    "JOIN images USING (image_id) LEFT JOIN keypoints USING (image_id)";

void CheckKeypointDepths(const KeypointDepths& keypoint_depths) {
  DGSFM_CHECK(IsFocalLength(keypoint_depths.focal_length_px))
      << keypoint_depths.focal_length_px;
  DGSFM_CHECK(AreDepths(keypoint_depths));
}

uint64_t KeypointsFingerprint(const SqliteStatement& row, int column) {
  FnvHash hash;
  hash.AddAll(row.Blob<uint32_t>(column));
  return hash.Value();
}

ImageKeypoints ReadImageKeypoints(const SqliteConnection& connection,
                                  colmap::image_t image_id) {
  SqliteStatement select(
      connection,
      "SELECT name, coalesce(keypoints.rows, 0), keypoints.data FROM images "
      "LEFT JOIN keypoints USING (image_id) WHERE images.image_id = ?",
      image_id);
  if (!select.Step()) {
    throw connection.Error() << "no image with id " << image_id;
  }
  return {select.Text(0), select.Int(1), KeypointsFingerprint(select, 2)};
}

DepthUnit CheckedUnit(const SqliteConnection& connection,
                      int64_t unit,
                      const std::string& image_name) {
  if (unit < static_cast<int>(DepthUnit::METRIC) ||
      unit > static_cast<int>(DepthUnit::AFFINE_DEPTH)) {
    throw connection.Error()
        << "image " << image_name << ": unknown depth unit " << unit
        << "; use the version of the program that wrote it";
  }
  return static_cast<DepthUnit>(unit);
}

KeypointDepths KeypointDepthsOfRow(const SqliteConnection& connection,
                                   const SqliteStatement& row) {
  const std::string name = row.Text(1);
  const int64_t num_keypoints = row.Int(2);
  const int64_t num_depths = row.Int(4);
  KeypointDepths depths;
  depths.unit = CheckedUnit(connection, row.Int(3), name);
  depths.depths = row.Blob<float>(5);
  depths.focal_length_px = row.Double(6);
  depths.source_fingerprint = static_cast<uint64_t>(row.Int(8));
  if (!IsFocalLength(depths.focal_length_px) ||
      num_depths != int64_t(depths.depths.size()) || !AreDepths(depths)) {
    throw connection.Error()
        << "image " << name
        << ": damaged depth at key points; run depth_importer again";
  }
  const auto fingerprint = static_cast<uint64_t>(row.Int(7));
  // Tables of the first versions have no fingerprints of key points.
  if (num_depths != num_keypoints ||
      (fingerprint != 0 && fingerprint != KeypointsFingerprint(row, 9))) {
    throw connection.Error()
        << "image " << name << " has " << num_keypoints
        << " key points, but depth was imported for "
        << (num_depths == num_keypoints ? "other " : "") << num_depths
        << "; features were "
        << (num_keypoints == 0 ? "deleted since: extract them and"
                               : "extracted again since:")
        << " run depth_importer again";
  }
  return depths;
}

}  // namespace dgsfm
