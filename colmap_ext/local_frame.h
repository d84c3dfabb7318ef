// Local east, north, up coordinates on the WGS84 ellipsoid.

#pragma once

#include <string>

#include <Eigen/Core>

namespace dgsfm {

struct GeodeticPosition {
  double latitude_deg = 0;
  double longitude_deg = 0;
  // Above the ellipsoid, or above what the source's altitudes count from [m].
  double altitude_m = 0;
};

// x east, y north, z up [m] about an origin: the topocentric frame of EPSG
// method 9837.
class LocalFrame {
 public:
  explicit LocalFrame(const GeodeticPosition& origin);

  const GeodeticPosition& Origin() const { return origin_; }
  Eigen::Vector3d FromGeodetic(const GeodeticPosition& position) const;
  GeodeticPosition ToGeodetic(const Eigen::Vector3d& local) const;

  // Earth-centred, earth-fixed coordinates [m] from local ones.
  Eigen::Matrix4d EcefFromLocal() const;
  // Operation of PROJ from local coordinates to longitude, latitude [deg] and
  // height [m].
  std::string ProjPipeline() const;
  // A projected coordinate system in WKT 2 whose eastings and northings are
  // those of the frame at the height of the ellipsoid.
  std::string Wkt() const;

 private:
  GeodeticPosition origin_;
  Eigen::Matrix3d local_from_ecef_;
  Eigen::Vector3d origin_in_ecef_;
};

}  // namespace dgsfm
