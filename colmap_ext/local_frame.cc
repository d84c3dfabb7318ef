#include "colmap_ext/local_frame.h"

#include <colmap/base/gps.h>

#include <cmath>
#include <iomanip>
#include <sstream>

namespace dgsfm {

namespace {

Eigen::Vector3d EcefOf(const GeodeticPosition& position) {
  return colmap::GPSTransform(colmap::GPSTransform::WGS84)
      .EllToXYZ({{position.latitude_deg,
                  position.longitude_deg,
                  position.altitude_m}})[0];
}

// Ten digits after the point: 0.01 mm of latitude.
std::string Text(double value) {
  std::ostringstream text;
  text << std::setprecision(14) << value;
  return text.str();
}

}  // namespace

LocalFrame::LocalFrame(const GeodeticPosition& origin)
    : origin_(origin), origin_in_ecef_(EcefOf(origin)) {
  const double latitude = origin.latitude_deg * M_PI / 180;
  const double longitude = origin.longitude_deg * M_PI / 180;
  const double sin_lat = std::sin(latitude), cos_lat = std::cos(latitude);
  const double sin_lon = std::sin(longitude), cos_lon = std::cos(longitude);
  local_from_ecef_ << -sin_lon, cos_lon, 0,             //
      -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat,  //
      cos_lat * cos_lon, cos_lat * sin_lon, sin_lat;
}

Eigen::Vector3d LocalFrame::FromGeodetic(
    const GeodeticPosition& position) const {
  return local_from_ecef_ * (EcefOf(position) - origin_in_ecef_);
}

GeodeticPosition LocalFrame::ToGeodetic(const Eigen::Vector3d& local) const {
  const Eigen::Vector3d position =
      colmap::GPSTransform(colmap::GPSTransform::WGS84)
          .XYZToEll(
              {local_from_ecef_.transpose() * local + origin_in_ecef_})[0];
  return {position.x(), position.y(), position.z()};
}

Eigen::Matrix4d LocalFrame::EcefFromLocal() const {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = local_from_ecef_.transpose();
  matrix.topRightCorner<3, 1>() = origin_in_ecef_;
  return matrix;
}

std::string LocalFrame::ProjPipeline() const {
  return "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0=" +
         Text(origin_.latitude_deg) + " +lon_0=" + Text(origin_.longitude_deg) +
         " +h_0=" + Text(origin_.altitude_m) +
         " +step +inv +proj=cart +ellps=WGS84"
         " +step +proj=unitconvert +xy_in=rad +xy_out=deg";
}

std::string LocalFrame::Wkt() const {
  const std::string degree = "ANGLEUNIT[\"degree\",0.0174532925199433]";
  const std::string metre = "LENGTHUNIT[\"metre\",1]";
  return "PROJCRS[\"Local east, north\",BASEGEOGCRS[\"WGS 84\",DATUM[\"World "
         "Geodetic System 1984\",ELLIPSOID[\"WGS 84\",6378137,298.257223563," +
         metre + "]],PRIMEM[\"Greenwich\",0," + degree +
         "]],CONVERSION[\"Local\",METHOD[\"Orthographic\",ID[\"EPSG\",9840]],"
         "PARAMETER[\"Latitude of natural origin\"," +
         Text(origin_.latitude_deg) + "," + degree +
         ",ID[\"EPSG\",8801]],PARAMETER[\"Longitude of natural origin\"," +
         Text(origin_.longitude_deg) + "," + degree +
         ",ID[\"EPSG\",8802]],PARAMETER[\"False easting\",0," + metre +
         ",ID[\"EPSG\",8806]],PARAMETER[\"False northing\",0," + metre +
         ",ID[\"EPSG\",8807]]],CS[Cartesian,2],AXIS[\"easting\",east,ORDER[1]]"
         ",AXIS[\"northing\",north,ORDER[2]]," +
         metre + "]";
}

}  // namespace dgsfm
