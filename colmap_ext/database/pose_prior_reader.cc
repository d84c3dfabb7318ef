#include "colmap_ext/database/pose_prior_reader.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

namespace dgsfm {

namespace {

bool HasColumn(const SqliteConnection& connection,
               const std::string& table,
               const std::string& column) {
  SqliteStatement select(
      connection, "SELECT count(*) FROM pragma_table_info(?) WHERE name = ?");
  select.Bind(table, column);
  return select.Step() && select.Int(0) > 0;
}

const colmap::Image* FindImage(const Scene& scene, int64_t image_id) {
  if (image_id < 0 || image_id >= static_cast<int64_t>(kMaxNumImages)) {
    return nullptr;
  }
  const auto image = scene.images.find(static_cast<colmap::image_t>(image_id));
  return image == scene.images.end() ? nullptr : &image->second;
}

// Empty if NULL.
std::vector<double> ReadNumbers(const SqliteConnection& connection,
                                const SqliteStatement& row,
                                int column,
                                size_t count,
                                const char* what,
                                const std::string& name) {
  std::vector<double> values;
  if (row.IsNull(column)) return values;
  const std::vector<char> bytes = row.Blob<char>(column);
  if (bytes.empty()) return values;
  if (bytes.size() != count * sizeof(double)) {
    throw connection.Error()
        << "image " << name << ": " << what << " has " << bytes.size()
        << " bytes, not " << count * sizeof(double);
  }
  values.resize(count);
  std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

PositionCoordinates CoordinatesOf(int64_t coordinate_system) {
  switch (coordinate_system) {
    case 0:
      return PositionCoordinates::WGS84;
    case 1:
      return PositionCoordinates::CARTESIAN;
    default:
      return PositionCoordinates::UNDEFINED;
  }
}

// COLMAP 3.11 to 3.13 have one row an image, later versions one for each datum
// of a sensor, of which those of type 0 are cameras and their data images.
std::string PosePriorQuery(const SqliteConnection& connection) {
  const bool has_image_id = HasColumn(connection, "pose_priors", "image_id");
  const auto column = [&](const std::string& name) {
    return HasColumn(connection, "pose_priors", name) ? name : "NULL";
  };
  return "SELECT " + std::string(has_image_id ? "image_id" : "corr_data_id") +
         ", " + column("position") + ", " + column("position_covariance") +
         ", " + column("gravity") + ", " + column("coordinate_system") +
         " FROM pose_priors" +
         (has_image_id ? " ORDER BY image_id"
                       : " WHERE corr_sensor_type = 0 ORDER BY corr_data_id");
}

GivenPoses ReadTable(const SqliteConnection& connection, const Scene& scene) {
  GivenPoses poses;
  SqliteStatement select(connection, PosePriorQuery(connection));
  while (select.Step()) {
    const colmap::Image* image = FindImage(scene, select.Int(0));
    if (image == nullptr) continue;
    const std::string& name = image->Name();
    GivenPose pose;
    const auto position =
        ReadNumbers(connection, select, 1, 3, "its position prior", name);
    // An altitude may be missing.
    if (!position.empty() && std::isfinite(position[0]) &&
        std::isfinite(position[1])) {
      pose.position = Eigen::Map<const Eigen::Vector3d>(position.data());
    }
    const auto covariance = ReadNumbers(
        connection, select, 2, 9, "the covariance of its position", name);
    if (!covariance.empty()) {
      const Eigen::Matrix3d matrix =
          Eigen::Map<const Eigen::Matrix3d>(covariance.data());
      if (!matrix.array().isNaN().any()) pose.covariance = matrix;
    }
    const auto gravity =
        ReadNumbers(connection, select, 3, 3, "its gravity", name);
    if (!gravity.empty()) {
      const Eigen::Vector3d vector =
          Eigen::Map<const Eigen::Vector3d>(gravity.data());
      if (vector.allFinite()) pose.gravity = vector;
    }
    if (!select.IsNull(4)) pose.coordinates = CoordinatesOf(select.Int(4));
    poses[image->ImageId()] = pose;
  }
  return poses;
}

void ReadColumns(const SqliteConnection& connection,
                 const Scene& scene,
                 GivenPoses* poses) {
  SqliteStatement select(connection,
                         "SELECT image_id, prior_tx, prior_ty, prior_tz FROM "
                         "images WHERE prior_tx IS NOT NULL AND prior_ty IS "
                         "NOT NULL ORDER BY image_id");
  while (select.Step()) {
    const colmap::Image* image = FindImage(scene, select.Int(0));
    if (image == nullptr) continue;
    const Eigen::Vector3d position(
        select.Double(1),
        select.Double(2),
        select.IsNull(3) ? std::numeric_limits<double>::quiet_NaN()
                         : select.Double(3));
    (*poses)[image->ImageId()].position = position;
  }
}

bool HasPosition(const GivenPoses& poses) {
  for (const auto& [image_id, pose] : poses) {
    if (pose.position) return true;
  }
  return false;
}

}  // namespace

GivenPoses ReadPosePriors(const SqliteConnection& connection,
                          const Scene& scene) {
  GivenPoses poses;
  if (connection.HasTable("pose_priors")) {
    poses = ReadTable(connection, scene);
  }
  if (!HasPosition(poses) && HasColumn(connection, "images", "prior_tx")) {
    ReadColumns(connection, scene, &poses);
  }
  return poses;
}

}  // namespace dgsfm
