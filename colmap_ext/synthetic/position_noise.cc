#include "colmap_ext/synthetic/position_noise.h"

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/synthetic/random_stream.h"

#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace dgsfm {

namespace {

// Streams of this file; those of the scene have smaller numbers.
enum Purpose : uint32_t {
  POSITIONS = 100,
  POSITION_OUTLIERS = 101,
  GRAVITY = 102,
  GRAVITY_OUTLIERS = 103,
};

// As COLMAP 4.x creates it.
constexpr char kTable[] = R"(
CREATE TABLE pose_priors (
  pose_prior_id INTEGER PRIMARY KEY NOT NULL,
  corr_data_id INTEGER NOT NULL, corr_sensor_id INTEGER NOT NULL,
  corr_sensor_type INTEGER NOT NULL,
  position BLOB, position_covariance BLOB, gravity BLOB,
  coordinate_system INTEGER NOT NULL);
CREATE UNIQUE INDEX pose_prior_data_assignment
  ON pose_priors(corr_data_id, corr_sensor_id, corr_sensor_type);
)";

std::vector<char> DrawOutliers(double outlier_ratio,
                               Purpose purpose,
                               const SyntheticScene& scene) {
  std::vector<size_t> order(scene.images.size());
  std::iota(order.begin(), order.end(), 0);
  RandomStream(scene.options.random_seed, purpose).Shuffle(&order);
  order.resize(std::lround(outlier_ratio * double(order.size())));
  std::vector<char> is_outlier(scene.images.size(), 0);
  for (const size_t i : order) is_outlier[i] = 1;
  return is_outlier;
}

Eigen::Vector3d DrawPosition(const PositionNoiseOptions& options,
                             const SyntheticScene& scene,
                             const SyntheticImage& image,
                             bool is_outlier) {
  RandomStream random(scene.options.random_seed, POSITIONS, image.image_id);
  Eigen::Vector3d position = image.cam_from_world.TargetOriginInSource();
  for (int i = 0; i < 3; ++i) position(i) += options.stddev_m * random.Normal();
  position.z() += options.altitude_offset_m;
  const double azimuth = random.Uniform(0, 2 * M_PI);
  if (is_outlier) {
    position.head<2>() += options.outlier_m *
                          Eigen::Vector2d(std::cos(azimuth), std::sin(azimuth));
  }
  return position;
}

Eigen::Vector3d DrawGravity(const PositionNoiseOptions& options,
                            const SyntheticScene& scene,
                            const SyntheticImage& image,
                            bool is_outlier) {
  RandomStream random(scene.options.random_seed, GRAVITY, image.image_id);
  Eigen::Vector3d gravity =
      image.cam_from_world.rotation * -Eigen::Vector3d::UnitZ();
  for (int i = 0; i < 3; ++i) {
    gravity(i) += options.gravity_stddev_deg * M_PI / 180 * random.Normal();
  }
  if (is_outlier) {
    for (int i = 0; i < 3; ++i) gravity(i) = random.Normal();
  }
  return gravity.normalized();
}

}  // namespace

bool PositionNoiseOptions::IsValid(std::string* error) const {
  const auto check = [error](const char* name, bool holds) {
    if (!holds) *error = std::string(name) + " is out of range";
    return holds;
  };
  return check("gps_noise", stddev_m > 0 && std::isfinite(stddev_m)) &&
         check("gps_outlier_ratio", outlier_ratio >= 0 && outlier_ratio <= 1) &&
         check("gps_outlier", std::isfinite(outlier_m)) &&
         check("gps_altitude_offset", std::isfinite(altitude_offset_m)) &&
         check("gravity_noise",
               gravity_stddev_deg >= 0 && gravity_stddev_deg < 90) &&
         check("gravity_outlier_ratio",
               gravity_outlier_ratio >= 0 && gravity_outlier_ratio <= 1);
}

LocalFrame SyntheticFrame() { return LocalFrame({48, 11, 500}); }

GivenPoses SynthesizePosePriors(const PositionNoiseOptions& options,
                                const SyntheticScene& scene) {
  GivenPoses poses;
  if (!options.has_positions && !options.has_gravity) return poses;
  const LocalFrame frame = SyntheticFrame();
  const std::vector<char> is_position_outlier =
      DrawOutliers(options.outlier_ratio, POSITION_OUTLIERS, scene);
  const std::vector<char> is_gravity_outlier =
      DrawOutliers(options.gravity_outlier_ratio, GRAVITY_OUTLIERS, scene);
  size_t i = 0;
  for (const auto& [image_id, image] : scene.images) {
    GivenPose& pose = poses[image_id];
    pose.coordinates = options.coordinates;
    const size_t index = i++;
    if (options.has_gravity) {
      pose.gravity =
          DrawGravity(options, scene, image, is_gravity_outlier[index]);
    }
    if (!options.has_positions) continue;
    const Eigen::Vector3d local =
        DrawPosition(options, scene, image, is_position_outlier[index]);
    pose.position = local;
    pose.covariance =
        options.stddev_m * options.stddev_m * Eigen::Matrix3d::Identity();
    if (options.coordinates != PositionCoordinates::WGS84) continue;
    const GeodeticPosition geodetic = frame.ToGeodetic(local);
    pose.position = Eigen::Vector3d(
        geodetic.latitude_deg, geodetic.longitude_deg, geodetic.altitude_m);
  }
  return poses;
}

void WritePosePriors(const GivenPoses& poses,
                     const SyntheticScene& scene,
                     const std::string& database_path) {
  if (poses.empty()) return;
  const SqliteConnection connection(database_path,
                                    SqliteConnection::Mode::READ_WRITE);
  SqliteTransaction transaction(connection, SqliteTransaction::Kind::WRITE);
  connection.Execute(kTable);
  SqliteStatement row(
      connection,
      "INSERT INTO pose_priors(corr_data_id, corr_sensor_id, corr_sensor_type, "
      "position, position_covariance, gravity, coordinate_system) "
      "VALUES(?, ?, 0, ?, ?, ?, ?)");
  const Eigen::Matrix3d unknown =
      Eigen::Matrix3d::Constant(std::numeric_limits<double>::quiet_NaN());
  for (const auto& [image_id, pose] : poses) {
    const Eigen::Vector3d position =
        pose.position.value_or(Eigen::Vector3d(unknown.col(0)));
    const Eigen::Matrix3d covariance = pose.covariance.value_or(unknown);
    const Eigen::Vector3d gravity =
        pose.gravity.isZero(0) ? Eigen::Vector3d(unknown.col(0)) : pose.gravity;
    row.Bind(image_id,
             scene.images.at(image_id).camera_id,
             position,
             covariance,
             gravity,
             pose.coordinates == PositionCoordinates::WGS84 ? 0 : 1)
        .Run();
  }
  transaction.Commit();
}

}  // namespace dgsfm
