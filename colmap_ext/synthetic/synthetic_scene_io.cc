#include "colmap_ext/synthetic/synthetic_scene_io.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/pose_access.h"

#include <colmap/base/track.h>
#include <colmap/estimators/fundamental_matrix.h>
#include <colmap/estimators/two_view_geometry.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <utility>
#include <vector>

namespace dgsfm {

namespace {

// As COLMAP 3.8 creates them. Its own class ends the program, with lines that
// name no file, where a database cannot be written.
constexpr char kTables[] = R"(
CREATE TABLE cameras (
  camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  model INTEGER NOT NULL, width INTEGER NOT NULL, height INTEGER NOT NULL,
  params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (
  image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL,
  prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL,
  prior_tx REAL, prior_ty REAL, prior_tz REAL,
  CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
  FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE keypoints (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (
  pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (
  pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);
PRAGMA user_version = 3800;
)";

colmap::Camera CameraForMapper(const SyntheticScene& synthetic,
                               const colmap::Camera& truth) {
  if (synthetic.options.known_focal_length) return truth;
  colmap::Camera camera = truth;
  camera.InitializeWithId(truth.ModelId(),
                          1.2 * std::max(truth.Width(), truth.Height()),
                          truth.Width(),
                          truth.Height());
  camera.SetPriorFocalLength(false);
  return camera;
}

colmap::Image ImageWithoutPose(const SyntheticImage& synthetic) {
  colmap::Image image;
  image.SetImageId(synthetic.image_id);
  image.SetName(synthetic.name);
  image.SetCameraId(synthetic.camera_id);
  image.SetPoints2D(synthetic.keypoints);
  return image;
}

colmap::FeatureMatches InlierMatches(const SyntheticPair& pair) {
  colmap::FeatureMatches inliers;
  for (size_t i = 0; i < pair.matches.size(); ++i) {
    if (pair.is_inlier[i]) inliers.push_back(pair.matches[i]);
  }
  return inliers;
}

// As COLMAP's verification leaves it: the inliers, and a fundamental matrix
// fitted to them; the true one would tell what the noise hides. The pose and
// the essential matrix are left to the mappers.
colmap::TwoViewGeometry VerifiedPair(const SyntheticScene& synthetic,
                                     const SyntheticPair& pair,
                                     const SyntheticImage& image1,
                                     const SyntheticImage& image2) {
  using FundamentalEstimator = colmap::FundamentalMatrixEightPointEstimator;
  colmap::TwoViewGeometry geometry;
  geometry.config = synthetic.options.known_focal_length
                        ? colmap::TwoViewGeometry::CALIBRATED
                        : colmap::TwoViewGeometry::UNCALIBRATED;
  geometry.inlier_matches = InlierMatches(pair);
  if (geometry.inlier_matches.size() < FundamentalEstimator::kMinNumSamples) {
    return geometry;
  }
  std::vector<Eigen::Vector2d> xys1, xys2;
  for (const colmap::FeatureMatch& match : geometry.inlier_matches) {
    xys1.push_back(image1.keypoints[match.point2D_idx1]);
    xys2.push_back(image2.keypoints[match.point2D_idx2]);
  }
  geometry.F = FundamentalEstimator::Estimate(xys1, xys2)[0];
  return geometry;
}

void WriteCamerasAndImages(const SyntheticScene& synthetic,
                           const SqliteConnection& connection) {
  SqliteStatement camera_row(
      connection,
      "INSERT INTO cameras(camera_id, model, width, height, params, "
      "prior_focal_length) VALUES(?, ?, ?, ?, ?, ?)");
  for (const auto& [camera_id, truth] : synthetic.cameras) {
    const colmap::Camera camera = CameraForMapper(synthetic, truth);
    camera_row
        .Bind(camera_id,
              camera.ModelId(),
              camera.Width(),
              camera.Height(),
              camera.Params(),
              camera.HasPriorFocalLength())
        .Run();
  }
  SqliteStatement image_row(
      connection,
      "INSERT INTO images(image_id, name, camera_id) VALUES(?, ?, ?)");
  SqliteStatement keypoint_row(
      connection,
      "INSERT INTO keypoints(image_id, rows, cols, data) VALUES(?, ?, 6, ?)");
  for (const auto& [image_id, image] : synthetic.images) {
    image_row.Bind(image_id, image.name, image.camera_id).Run();
    // With the affine shape of a feature of scale 1.
    std::vector<float> values;
    for (const Eigen::Vector2d& xy : image.keypoints) {
      values.insert(values.end(), {float(xy.x()), float(xy.y()), 1, 0, 0, 1});
    }
    keypoint_row.Bind(image_id, image.keypoints.size(), values).Run();
  }
}

std::vector<uint32_t> FlattenMatches(const colmap::FeatureMatches& matches) {
  std::vector<uint32_t> flat;
  for (const colmap::FeatureMatch& match : matches) {
    flat.insert(flat.end(), {match.point2D_idx1, match.point2D_idx2});
  }
  return flat;
}

void WritePairs(const SyntheticScene& synthetic,
                const SqliteConnection& connection) {
  SqliteStatement match_row(
      connection,
      "INSERT INTO matches(pair_id, rows, cols, data) VALUES(?, ?, 2, ?)");
  SqliteStatement geometry_row(
      connection,
      "INSERT INTO two_view_geometries(pair_id, rows, cols, data, config, F, "
      "E, H, qvec, tvec) VALUES(?, ?, 2, ?, ?, ?, ?, ?, ?, ?)");
  for (const auto& [pair_id, pair] : synthetic.pairs) {
    match_row.Bind(pair_id, pair.matches.size(), FlattenMatches(pair.matches))
        .Run();
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const colmap::TwoViewGeometry geometry =
        VerifiedPair(synthetic,
                     pair,
                     synthetic.images.at(image_id1),
                     synthetic.images.at(image_id2));
    // The database has rows after each other, Eigen columns.
    const Eigen::Matrix3d F_rows = geometry.F.transpose();
    geometry_row
        .Bind(pair_id,
              geometry.inlier_matches.size(),
              FlattenMatches(geometry.inlier_matches),
              geometry.config,
              F_rows,
              geometry.E,
              geometry.H,
              geometry.qvec,
              geometry.tvec)
        .Run();
  }
}

}  // namespace

Scene SceneFromSynthetic(const SyntheticScene& synthetic) {
  Scene scene;
  for (const auto& [camera_id, camera] : synthetic.cameras) {
    scene.cameras.emplace(camera_id, CameraForMapper(synthetic, camera));
  }
  for (const auto& [image_id, image] : synthetic.images) {
    scene.images.emplace(image_id, ImageWithoutPose(image));
  }
  for (const auto& [pair_id, pair] : synthetic.pairs) {
    scene.matches.emplace(pair_id, pair.matches);
  }
  return scene;
}

std::map<colmap::image_t, KeypointDepths> KeypointDepthsFromSynthetic(
    const SyntheticScene& synthetic) {
  std::map<colmap::image_t, KeypointDepths> depths;
  for (const auto& [image_id, image] : synthetic.images) {
    if (image.prior_depths.empty()) continue;
    depths[image_id].depths = image.prior_depths;
  }
  return depths;
}

DepthMap DepthMapFromSynthetic(const SyntheticScene& synthetic,
                               colmap::image_t image_id,
                               int cell_size_px) {
  DGSFM_CHECK(cell_size_px > 0) << "cell_size_px = " << cell_size_px;
  const SyntheticImage& image = synthetic.images.at(image_id);
  DGSFM_CHECK(!image.prior_depths.empty())
      << "image " << image.name << " has no depth";
  const Eigen::Vector2d size = ImageSize(synthetic.cameras.at(image.camera_id));
  DepthMap map;
  map.width = std::max(1, static_cast<int>(size.x()) / cell_size_px);
  map.height = std::max(1, static_cast<int>(size.y()) / cell_size_px);
  map.values.assign(size_t(map.width) * map.height, 0);
  for (size_t i = 0; i < image.keypoints.size(); ++i) {
    const Eigen::Vector2d& xy = image.keypoints[i];
    const int x = std::min(static_cast<int>(xy.x() * map.width / size.x()),
                           map.width - 1);
    const int y = std::min(static_cast<int>(xy.y() * map.height / size.y()),
                           map.height - 1);
    map.values[size_t(y) * map.width + x] = image.prior_depths[i];
  }
  return map;
}

colmap::Reconstruction ReconstructionFromSynthetic(
    const SyntheticScene& synthetic) {
  colmap::Reconstruction reconstruction;
  for (const auto& [camera_id, camera] : synthetic.cameras) {
    reconstruction.AddCamera(camera);
  }
  std::vector<colmap::Track> tracks(synthetic.points.size());
  for (const auto& [image_id, image] : synthetic.images) {
    colmap::Image colmap_image = ImageWithoutPose(image);
    SetCamFromWorld(image.cam_from_world, &colmap_image);
    reconstruction.AddImage(colmap_image);
    reconstruction.RegisterImage(image_id);
    for (size_t i = 0; i < image.point_idxs.size(); ++i) {
      const int point_idx = image.point_idxs[i];
      if (point_idx >= 0) tracks[point_idx].AddElement(image_id, i);
    }
  }
  for (size_t i = 0; i < tracks.size(); ++i) {
    if (tracks[i].Length() < 2) continue;
    reconstruction.AddPoint3D(synthetic.points[i], tracks[i]);
  }
  return reconstruction;
}

void WriteSyntheticDatabase(const SyntheticScene& synthetic,
                            const std::string& path) {
  if (std::filesystem::exists(path)) {
    throw std::runtime_error("'" + path + "' exists already");
  }
  const SqliteConnection connection(path, SqliteConnection::Mode::CREATE);
  SqliteTransaction transaction(connection, SqliteTransaction::Kind::WRITE);
  connection.Execute(kTables);
  WriteCamerasAndImages(synthetic, connection);
  WritePairs(synthetic, connection);
  transaction.Commit();
}

}  // namespace dgsfm
