#include "controllers/pose_prior_loader.h"

#include "colmap_ext/database/pose_prior_reader.h"
#include "colmap_ext/formats/image_gps.h"
#include "colmap_ext/output_file.h"
#include "controllers/pose_prior_file.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <sstream>
#include <stdexcept>

#include <Eigen/Cholesky>
#include <glog/logging.h>

namespace dgsfm {

namespace {

// Positions less certain than this fix nothing on earth [m].
constexpr double kMaxStddev = 1e6;
// Vertical standard deviation of positions without altitude [m].
constexpr double kUnknownAltitudeStddev = 1e4;
// The origin of the local frame is rounded to this, so that it is short in
// texts [deg].
constexpr double kOriginUnitDeg = 1e-5;

std::optional<PositionCoordinates> ParseCoordinates(const std::string& text) {
  if (text == "wgs84") return PositionCoordinates::WGS84;
  if (text == "cartesian") return PositionCoordinates::CARTESIAN;
  return std::nullopt;
}

std::optional<GeodeticPosition> ParseOrigin(const std::string& text) {
  std::istringstream stream(text);
  GeodeticPosition origin;
  char comma1 = 0, comma2 = 0;
  if (stream >> origin.latitude_deg >> comma1 >> origin.longitude_deg >>
          comma2 >> origin.altitude_m &&
      comma1 == ',' && comma2 == ',' && (stream >> std::ws).eof() &&
      std::abs(origin.latitude_deg) <= 90 &&
      std::abs(origin.longitude_deg) <= 180) {
    return origin;
  }
  return std::nullopt;
}

// Positions of images and where they are from, for messages.
class PositionCollector {
 public:
  explicit PositionCollector(const Scene& scene) : scene_(scene) {}

  // Takes the positions of images that have none yet, and gravity.
  void Add(const GivenPoses& poses,
           PositionCoordinates default_coordinates,
           const std::string& source) {
    size_t num_added = 0, num_ignored = 0;
    for (const auto& [image_id, given] : poses) {
      GivenPose pose = given;
      if (pose.coordinates == PositionCoordinates::UNDEFINED) {
        pose.coordinates = default_coordinates;
      }
      GivenPose& taken = poses_[image_id];
      if (taken.gravity.isZero(0)) taken.gravity = pose.gravity;
      if (!pose.position || taken.position) continue;
      if (!coordinates_) coordinates_ = pose.coordinates;
      if (pose.coordinates != *coordinates_) {
        ++num_ignored;
        continue;
      }
      const Eigen::Vector3d gravity = taken.gravity;
      taken = pose;
      taken.gravity = gravity;
      ++num_added;
    }
    if (num_added > 0) {
      LOG(INFO) << "Positions of " << num_added << " images from " << source;
    }
    if (num_ignored > 0) {
      warnings_.push_back(std::to_string(num_ignored) + " positions of " +
                          source +
                          " are not used: others are in another kind of "
                          "coordinates (wgs84, cartesian)");
    }
  }

  // Drops positions for which `is_bad` holds, with a warning.
  void Drop(const std::function<bool(const GivenPose&)>& is_bad,
            const std::string& what,
            bool warn = true) {
    size_t num_dropped = 0;
    std::string first;
    for (auto& [image_id, pose] : poses_) {
      if (!pose.position || !is_bad(pose)) continue;
      pose.position.reset();
      if (num_dropped++ == 0) first = scene_.images.at(image_id).Name();
    }
    if (num_dropped == 0) return;
    const std::string text = std::to_string(num_dropped) + " positions, e.g. " +
                             "of image " + first + ", " + what;
    if (warn) {
      warnings_.push_back(text);
    } else {
      LOG(INFO) << text;
    }
  }

  void DropImpossible() {
    Drop(
        [](const GivenPose& pose) {
          return pose.covariance && !(pose.covariance->diagonal().maxCoeff() <
                                      kMaxStddev * kMaxStddev);
        },
        "have no finite error and are not used",
        /*warn=*/false);
    Drop(
        [](const GivenPose& pose) {
          return !pose.position->head<2>().allFinite() ||
                 !IsNearEarth(pose.coordinates, *pose.position);
        },
        "are not near the earth and are not used");
    if (coordinates_ != PositionCoordinates::WGS84) {
      Drop([](const GivenPose& pose) { return !pose.position->allFinite(); },
           "have no z and are not used");
      return;
    }
    Drop(
        [](const GivenPose& pose) {
          return std::abs(pose.position->x()) > 90 &&
                 std::abs(pose.position->y()) <= 90;
        },
        "have a latitude beyond 90 degrees and are not used: latitude and "
        "longitude may be swapped (the first is latitude), or the coordinates "
        "are metres (--pose_priors_coordinates cartesian)");
    Drop(
        [](const GivenPose& pose) {
          return std::abs(pose.position->x()) > 90 ||
                 std::abs(pose.position->y()) > 180;
        },
        "are no latitude and longitude and are not used; for metres: "
        "--pose_priors_coordinates cartesian");
    Drop(
        [](const GivenPose& pose) {
          return pose.position->head<2>().isZero(0);
        },
        "are latitude 0, longitude 0, which receivers without a fix write, "
        "and are not used");
  }

  void DropIdentical() {
    const Eigen::Vector3d* first = nullptr;
    size_t num_positions = 0;
    for (const auto& [image_id, pose] : poses_) {
      if (!pose.position) continue;
      ++num_positions;
      if (first == nullptr) {
        first = &*pose.position;
      } else if (pose.position->head<2>() != first->head<2>()) {
        return;
      }
    }
    if (num_positions < 2) return;
    Drop([](const GivenPose&) { return true; },
         "are all the same, as those of phones indoors, and are not used");
  }

  const GivenPoses& Poses() const { return poses_; }
  std::optional<PositionCoordinates> Coordinates() const {
    return coordinates_;
  }
  bool HasAll() const {
    return std::all_of(
        scene_.images.begin(), scene_.images.end(), [&](const auto& image) {
          const auto pose = poses_.find(image.first);
          return pose != poses_.end() && pose->second.position;
        });
  }
  const std::vector<std::string>& Warnings() const { return warnings_; }

 private:
  const Scene& scene_;
  GivenPoses poses_;
  std::optional<PositionCoordinates> coordinates_;
  std::vector<std::string> warnings_;
};

GivenPoses ReadExifPositions(const std::string& image_path,
                             double stddev_vertical_m,
                             const Scene& scene) {
  GivenPoses poses;
  for (const auto& [image_id, image] : scene.images) {
    try {
      const auto gps = ReadImageGps(PathInside(image_path, image.Name()));
      if (!gps) continue;
      GivenPose& pose = poses[image_id];
      pose.coordinates = PositionCoordinates::WGS84;
      pose.position = Eigen::Vector3d(
          gps->latitude_deg, gps->longitude_deg, gps->altitude_m);
      if (gps->horizontal_error_m > 0) {
        const double error = gps->horizontal_error_m;
        pose.covariance =
            Eigen::Vector3d(error, error, std::max(stddev_vertical_m, error))
                .cwiseAbs2()
                .asDiagonal();
      }
    } catch (const std::runtime_error& error) {
      LOG(WARNING) << "No EXIF data: " << error.what();
    }
  }
  return poses;
}

// The median of each coordinate, about the longitude of the first.
GeodeticPosition MedianPosition(const GivenPoses& poses) {
  std::vector<double> latitudes, longitudes, altitudes;
  double first = 0;
  for (const auto& [image_id, pose] : poses) {
    if (!pose.position) continue;
    if (latitudes.empty()) first = pose.position->y();
    latitudes.push_back(pose.position->x());
    longitudes.push_back(std::remainder(pose.position->y() - first, 360));
    if (std::isfinite(pose.position->z())) {
      altitudes.push_back(pose.position->z());
    }
  }
  const auto rounded = [](double value) {
    return std::round(value / kOriginUnitDeg) * kOriginUnitDeg;
  };
  GeodeticPosition median;
  median.latitude_deg = rounded(Median(latitudes));
  median.longitude_deg =
      rounded(std::remainder(first + Median(longitudes), 360));
  if (!altitudes.empty()) median.altitude_m = std::round(Median(altitudes));
  return median;
}

Eigen::Matrix3d CovarianceOf(const PosePriorOptions& options,
                             const GivenPose& pose,
                             bool* is_given) {
  *is_given = pose.covariance && pose.covariance->allFinite() &&
              pose.covariance->llt().info() == Eigen::Success;
  if (*is_given) return *pose.covariance;
  return Eigen::Vector3d(options.stddev_horizontal_m,
                         options.stddev_horizontal_m,
                         options.stddev_vertical_m)
      .cwiseAbs2()
      .asDiagonal();
}

// Geodetic if there is a frame.
PosePrior PriorOf(const PosePriorOptions& options,
                  const GivenPose& pose,
                  const std::optional<LocalFrame>& frame) {
  PosePrior prior;
  if (pose.gravity.norm() > 1e-6) prior.gravity = pose.gravity.normalized();
  if (!pose.position) return prior;
  prior.covariance = CovarianceOf(options, pose, &prior.has_covariance);
  Eigen::Vector3d position = *pose.position;
  if (!std::isfinite(position.z())) {
    position.z() = frame ? frame->Origin().altitude_m : 0;
    prior.covariance.row(2).setZero();
    prior.covariance.col(2).setZero();
    prior.covariance(2, 2) = kUnknownAltitudeStddev * kUnknownAltitudeStddev;
  }
  prior.position =
      frame ? frame->FromGeodetic({position.x(), position.y(), position.z()})
            : position;
  return prior;
}

// Priors with latitude and longitude exchanged; empty if a longitude lies
// beyond 90 degrees.
PosePriors SwappedPriors(const PosePriorOptions& options, GivenPoses poses) {
  for (auto& [image_id, pose] : poses) {
    if (!pose.position) continue;
    if (std::abs(pose.position->y()) > 90) return PosePriors();
    std::swap(pose.position->x(), pose.position->y());
  }
  PosePriors priors;
  const LocalFrame frame(MedianPosition(poses));
  for (const auto& [image_id, pose] : poses) {
    if (pose.position) priors[image_id] = PriorOf(options, pose, frame);
  }
  return priors;
}

void WarnOfMissingAltitudes(LoadedPosePriors* loaded,
                            const GivenPoses& poses,
                            const Scene& scene) {
  size_t num_missing = 0;
  std::string first;
  for (const auto& [image_id, pose] : poses) {
    if (!pose.position || std::isfinite(pose.position->z())) continue;
    if (num_missing++ == 0) first = scene.images.at(image_id).Name();
  }
  if (num_missing == 0) return;
  loaded->warnings.push_back(std::to_string(num_missing) +
                             " positions, e.g. of image " + first +
                             ", have no altitude: they count horizontally");
}

}  // namespace

bool PosePriorOptions::IsValid(std::string* error) const {
  if (!ParseCoordinates(coordinates)) {
    *error = "pose_priors_coordinates is '" + coordinates +
             "' but must be wgs84 or cartesian";
    return false;
  }
  if (!origin.empty() && !ParseOrigin(origin)) {
    *error = "georeference_origin is '" + origin +
             "' but must be latitude,longitude,altitude";
    return false;
  }
  return OptionBounds(error)
      .Above("pose_priors_std_horizontal", stddev_horizontal_m, 0)
      .Above("pose_priors_std_vertical", stddev_vertical_m, 0)
      .AreKept();
}

LoadedPosePriors LoadPosePriors(const PosePriorOptions& options,
                                const std::string& database_path,
                                const std::string& image_path,
                                const Scene& scene) {
  LoadedPosePriors loaded;
  if (!options.use_pose_priors) return loaded;
  const PositionCoordinates coordinates =
      *ParseCoordinates(options.coordinates);
  PositionCollector collector(scene);
  if (!options.path.empty()) {
    collector.Add(ReadPosePriorFile(options.path, coordinates, scene),
                  coordinates,
                  options.path);
  }
  const SqliteConnection connection(database_path,
                                    SqliteConnection::Mode::READ_ONLY);
  collector.Add(ReadPosePriors(connection, scene), coordinates, database_path);
  if (!image_path.empty() && !collector.HasAll()) {
    collector.Add(
        ReadExifPositions(image_path, options.stddev_vertical_m, scene),
        PositionCoordinates::WGS84,
        "the EXIF data of the images");
  }
  collector.DropImpossible();
  collector.DropIdentical();
  loaded.warnings = collector.Warnings();
  const GivenPoses& poses = collector.Poses();
  const bool has_positions =
      std::any_of(poses.begin(), poses.end(), [](const auto& pose) {
        return pose.second.position.has_value();
      });
  if (has_positions && collector.Coordinates() == PositionCoordinates::WGS84) {
    loaded.frame.emplace(options.origin.empty() ? MedianPosition(poses)
                                                : *ParseOrigin(options.origin));
  }
  if (loaded.frame) loaded.swapped_priors = SwappedPriors(options, poses);
  WarnOfMissingAltitudes(&loaded, poses, scene);
  for (const auto& [image_id, pose] : poses) {
    const PosePrior prior = PriorOf(options, pose, loaded.frame);
    if (prior.HasPosition() || prior.HasGravity()) {
      loaded.priors[image_id] = prior;
    }
  }
  return loaded;
}

}  // namespace dgsfm
