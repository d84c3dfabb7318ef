// The pose priors of a COLMAP database of any version from 3.8 to 4.2.

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/given_pose.h"
#include "colmap_ext/scene.h"

namespace dgsfm {

// Reads position, covariance and gravity of the table pose_priors (COLMAP 3.11
// to 4.2) or, where it has no positions, the columns prior_tx, prior_ty and
// prior_tz of the images (COLMAP 3.8). Values that are not finite are unknown.
// Throws std::runtime_error naming the image if a value has another type or
// size than COLMAP gives it.
GivenPoses ReadPosePriors(const SqliteConnection& connection,
                          const Scene& scene);

}  // namespace dgsfm
