// Positions of images in a text file.

#pragma once

#include "colmap_ext/given_pose.h"
#include "colmap_ext/scene.h"

#include <string>

namespace dgsfm {

// Whether coordinates may be those of a camera: for WGS84 the altitude alone
// counts [m], which may be unknown (NaN).
bool IsNearEarth(PositionCoordinates coordinates,
                 const Eigen::Vector3d& position);

// Reads lines "name a b c [std_horizontal std_vertical]", separated by spaces
// or, which allows spaces in names, by commas: latitude, longitude [deg] and
// altitude [m], or x, y, z [m], as `coordinates` has it. An altitude of "-" is
// unknown. Empty lines and lines that begin with # do not count. Throws
// std::runtime_error naming file and line on what it cannot read, on positions
// that are not near the earth and on names given twice; and naming the file if
// none of its names is that of an image. Other names that the scene lacks are
// counted in a warning.
GivenPoses ReadPosePriorFile(const std::string& path,
                             PositionCoordinates coordinates,
                             const Scene& scene);

}  // namespace dgsfm
