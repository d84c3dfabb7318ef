#include "controllers/pose_prior_file.h"

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <boost/algorithm/string.hpp>
#include <glog/logging.h>

namespace dgsfm {

namespace {

// The deepest sea and satellites of low orbits [m].
constexpr double kMinAltitude = -12e3;
constexpr double kMaxAltitude = 1e6;
// Some earth radii, for earth-centred coordinates [m].
constexpr double kMaxCoordinate = 1e8;

constexpr char kByteOrderMark[] = "\xef\xbb\xbf";

std::string Trim(const std::string& text) {
  return boost::trim_copy_if(text, boost::is_any_of(" \t\r\""));
}

std::vector<std::string> SplitLine(const std::string& line) {
  std::vector<std::string> fields;
  std::istringstream stream(line);
  std::string field;
  if (line.find(',') != std::string::npos) {
    while (std::getline(stream, field, ',')) fields.push_back(Trim(field));
  } else {
    while (stream >> field) fields.push_back(field);
  }
  return fields;
}

// Throws std::runtime_error for other text.
double ParseNumber(const std::string& text, const std::string& place) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') {
    throw std::runtime_error(place + ": '" + text + "' is no number");
  }
  return value;
}

GivenPose ParseFields(const std::vector<std::string>& fields,
                      PositionCoordinates coordinates,
                      const std::string& place) {
  if (fields.size() != 4 && fields.size() != 6) {
    throw std::runtime_error(
        place + ": has " + std::to_string(fields.size()) +
        " fields, not 4 or 6: name, three coordinates, and perhaps horizontal "
        "and vertical standard deviation");
  }
  GivenPose pose;
  pose.coordinates = coordinates;
  pose.position = Eigen::Vector3d(ParseNumber(fields[1], place),
                                  ParseNumber(fields[2], place),
                                  fields[3] == "-"
                                      ? std::numeric_limits<double>::quiet_NaN()
                                      : ParseNumber(fields[3], place));
  if (!IsNearEarth(coordinates, *pose.position)) {
    const bool is_geodetic = coordinates == PositionCoordinates::WGS84;
    throw std::runtime_error(
        place + ": image " + fields[0] + " would be at " +
        (is_geodetic ? "altitude " + fields[3]
                     : fields[1] + " " + fields[2] + " " + fields[3]) +
        " m, which is not near the earth: correct the line or leave it out");
  }
  if (fields.size() == 6) {
    const double horizontal = ParseNumber(fields[4], place);
    const double vertical = ParseNumber(fields[5], place);
    if (!(horizontal > 0) || !(vertical > 0)) {
      throw std::runtime_error(place +
                               ": standard deviations must be positive");
    }
    pose.covariance = Eigen::Vector3d(horizontal, horizontal, vertical)
                          .cwiseAbs2()
                          .asDiagonal();
  }
  return pose;
}

// A file that serves no image would look as if it were used.
[[noreturn]] void FailWithoutImage(const std::string& path,
                                   const std::string& first_unknown,
                                   const Scene& scene) {
  if (first_unknown.empty()) {
    throw std::runtime_error(path + " has no line 'name a b c' of an image");
  }
  const std::string example =
      scene.images.empty() ? ""
                           : ", such as " + scene.images.begin()->second.Name();
  throw std::runtime_error(
      path + ": no name is that of an image, the first is " + first_unknown +
      "; names have to be those of the database" + example);
}

}  // namespace

bool IsNearEarth(PositionCoordinates coordinates,
                 const Eigen::Vector3d& position) {
  if (coordinates == PositionCoordinates::WGS84) {
    return !(position.z() < kMinAltitude) && !(position.z() > kMaxAltitude);
  }
  return !(position.array().abs() > kMaxCoordinate).any();
}

GivenPoses ReadPosePriorFile(const std::string& path,
                             PositionCoordinates coordinates,
                             const Scene& scene) {
  std::map<std::string, colmap::image_t> image_ids;
  for (const auto& [image_id, image] : scene.images) {
    image_ids[image.Name()] = image_id;
  }
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot open '" + path + "'");
  GivenPoses poses;
  size_t num_unknown = 0;
  std::string line, first_unknown;
  for (int number = 1; std::getline(file, line); ++number) {
    if (number == 1 && line.rfind(kByteOrderMark, 0) == 0) {
      line.erase(0, std::strlen(kByteOrderMark));
    }
    const std::string trimmed = Trim(line);
    if (trimmed.empty() || trimmed[0] == '#') continue;
    const std::string place = path + ", line " + std::to_string(number);
    const std::vector<std::string> fields = SplitLine(trimmed);
    const GivenPose pose = ParseFields(fields, coordinates, place);
    const auto image_id = image_ids.find(fields[0]);
    if (image_id == image_ids.end()) {
      if (num_unknown++ == 0) first_unknown = fields[0];
      continue;
    }
    if (!poses.emplace(image_id->second, pose).second) {
      throw std::runtime_error(place + ": image " + fields[0] +
                               " has a position already");
    }
  }
  if (file.bad()) throw std::runtime_error("cannot read '" + path + "'");
  if (poses.empty()) FailWithoutImage(path, first_unknown, scene);
  if (num_unknown > 0) {
    LOG(WARNING) << path << " has positions of " << num_unknown
                 << " images that the database lacks, e.g. " << first_unknown;
  }
  return poses;
}

}  // namespace dgsfm
