// Rigs, sensors and frames of COLMAP databases from 3.12 on, and of COLMAP's
// rig_config.json.

#pragma once

#include "colmap_ext/scene.h"

#include <string>

namespace dgsfm {

// Rigs of several cameras with frames of several of the scene's images; others
// constrain nothing and are left out. Nothing where the database is older.
// Throws std::runtime_error naming the rig or frame where cameras or images do
// not exist, are in two, or have a pose that is none.
RigScene ReadRigs(const std::string& database_path, const Scene& scene);

// The same from a file of the command rig_configurator: images of one rig whose
// names differ by the prefixes of its cameras alone are a frame. Throws
// std::runtime_error naming file and prefix; so if the images of a prefix have
// several cameras.
RigScene ReadRigConfig(const std::string& path, const Scene& scene);

// Those of the file if its path is not empty, else those of the database.
RigScene ReadRigs(const std::string& database_path,
                  const std::string& rig_config_path,
                  const Scene& scene);

}  // namespace dgsfm
