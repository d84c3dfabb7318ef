#include "colmap_ext/database/pair_geometry_table.h"

#include "colmap_ext/check.h"

#include <cmath>
#include <stdexcept>

namespace dgsfm {
namespace {

// As in COLMAP's own tables: one row of two indices per match.
std::vector<uint32_t> FlattenMatches(const colmap::FeatureMatches& matches) {
  std::vector<uint32_t> flat;
  flat.reserve(2 * matches.size());
  for (const colmap::FeatureMatch& match : matches) {
    flat.push_back(match.point2D_idx1);
    flat.push_back(match.point2D_idx2);
  }
  return flat;
}

}  // namespace

void CheckPairGeometry(const PairGeometry& geometry) {
  PairStatusName(geometry.status);  // Throws if there is no such status.
  const Rigid3d& pose = geometry.cam2_from_cam1;
  // The quaternion comes back as it is, so it has to be a rotation.
  DGSFM_CHECK(std::abs(pose.rotation.norm() - 1) < 1e-6)
      << pose.rotation.norm();
  DGSFM_CHECK(pose.translation.allFinite());
  DGSFM_CHECK(std::isfinite(geometry.scale_1_from_2) &&
              geometry.scale_1_from_2 > 0)
      << geometry.scale_1_from_2;
  for (const double focal_length_px :
       {geometry.focal_length1_px, geometry.focal_length2_px}) {
    DGSFM_CHECK(std::isfinite(focal_length_px) && focal_length_px >= 0)
        << focal_length_px;
  }
  DGSFM_CHECK(std::isfinite(geometry.log_scale_stddev) &&
              geometry.log_scale_stddev >= 0)
      << geometry.log_scale_stddev;
  DGSFM_CHECK(geometry.depth_verified.size() == geometry.inlier_matches.size());
}

const char kPairGeometryColumns[] =
    "pair_id, status, qvec, tvec, has_scale, scale, focal1, focal2, "
    "estimated_focal1, estimated_focal2, degeneracies, log_scale_stddev, "
    "num_matches, rows, matches, depth_verified, fingerprint";

PairGeometry GeometryOfRow(
    const SqliteStatement& row,
    const std::function<void(const std::string& problem)>& fail) {
  const auto qvec = row.Blob<double>(2);
  const auto tvec = row.Blob<double>(3);
  const auto matches = row.Blob<uint32_t>(14);
  const size_t num_rows = matches.size() / 2;
  // Sizes come first: all that follows indexes these vectors.
  if (qvec.size() != 4 || tvec.size() != 3 ||
      row.Int(13) != static_cast<int64_t>(num_rows)) {
    fail("damaged geometry");
  }
  PairGeometry geometry;
  geometry.status = static_cast<PairStatus>(row.Int(1));
  geometry.cam2_from_cam1 = {{qvec[0], qvec[1], qvec[2], qvec[3]},
                             {tvec[0], tvec[1], tvec[2]}};
  geometry.has_scale = row.Int(4) != 0;
  geometry.scale_1_from_2 = row.Double(5);
  geometry.focal_length1_px = row.Double(6);
  geometry.focal_length2_px = row.Double(7);
  geometry.estimated_focal1 = row.Int(8) != 0;
  geometry.estimated_focal2 = row.Int(9) != 0;
  geometry.degeneracies = static_cast<uint32_t>(row.Int(10));
  geometry.log_scale_stddev = row.Double(11);
  geometry.num_matches = static_cast<size_t>(row.Int(12));
  geometry.depth_verified = row.Blob<uint8_t>(15);
  geometry.fingerprint = static_cast<uint64_t>(row.Int(16));
  geometry.inlier_matches.reserve(num_rows);
  for (size_t i = 0; i < num_rows; ++i) {
    geometry.inlier_matches.emplace_back(matches[2 * i], matches[2 * i + 1]);
  }
  // A wrong number in the file is an error of the data, not of a caller.
  try {
    CheckPairGeometry(geometry);
  } catch (const std::invalid_argument&) {
    fail("damaged geometry");
  }
  return geometry;
}

PairGeometryInserter::PairGeometryInserter(const SqliteConnection& connection)
    : insert_(
          connection,
          std::string("INSERT OR REPLACE INTO dgsfm_pair_geometries(") +
              kPairGeometryColumns +
              ") VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)") {}

void PairGeometryInserter::Insert(colmap::image_pair_t pair_id,
                                  const PairGeometry& geometry) {
  const Rigid3d& pose = geometry.cam2_from_cam1;
  const Eigen::Vector4d qvec = QvecFromRotation(pose.rotation);
  insert_
      .Bind(pair_id,
            geometry.status,
            qvec,
            pose.translation,
            geometry.has_scale,
            geometry.scale_1_from_2,
            geometry.focal_length1_px,
            geometry.focal_length2_px,
            geometry.estimated_focal1,
            geometry.estimated_focal2,
            geometry.degeneracies,
            geometry.log_scale_stddev,
            geometry.num_matches,
            geometry.inlier_matches.size(),
            FlattenMatches(geometry.inlier_matches),
            geometry.depth_verified,
            geometry.fingerprint)
      .Run();
}

// Joined by the ids in the pair id, images that have been deleted drop out.
PairGeometryCursor::PairGeometryCursor(const SqliteConnection& connection)
    : connection_(connection),
      select_(
          connection,
          std::string("SELECT pairs.*, image1.name, image2.name, "
                      "coalesce(keypoints1.rows, 0), "
                      "coalesce(keypoints2.rows, 0) FROM (SELECT ") +
              kPairGeometryColumns +
              " FROM dgsfm_pair_geometries) AS pairs "
              "JOIN images AS image1 ON image1.image_id = pair_id / 2147483647 "
              "JOIN images AS image2 ON image2.image_id = pair_id % 2147483647 "
              "LEFT JOIN keypoints AS keypoints1 "
              "ON keypoints1.image_id = image1.image_id "
              "LEFT JOIN keypoints AS keypoints2 "
              "ON keypoints2.image_id = image2.image_id ORDER BY pair_id") {}

colmap::image_pair_t PairGeometryCursor::PairId() const {
  return static_cast<colmap::image_pair_t>(select_.Int(0));
}

std::string PairGeometryCursor::PairName() const {
  return "pair " + select_.Text(17) + " - " + select_.Text(18);
}

PairGeometry PairGeometryCursor::Geometry() const {
  const auto fail = [&](const std::string& problem) {
    throw connection_.Error()
        << PairName() << ": " << problem
        << "; run depth_geometric_verifier with --restart 1";
  };
  PairGeometry geometry = GeometryOfRow(select_, fail);
  const int64_t num_keypoints1 = select_.Int(19);
  const int64_t num_keypoints2 = select_.Int(20);
  for (const colmap::FeatureMatch& match : geometry.inlier_matches) {
    if (match.point2D_idx1 >= num_keypoints1 ||
        match.point2D_idx2 >= num_keypoints2) {
      fail("its geometry refers to key points that are gone");
    }
  }
  return geometry;
}

}  // namespace dgsfm
