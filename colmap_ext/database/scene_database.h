// Reads a COLMAP database of any version from 3.8 to 4.2 into COLMAP's own
// types. Goes through our own SQLite connection with explicit columns: COLMAP
// 3.8's Database class must never open a foreign database (it overwrites
// user_version before it fails).

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/scene.h"

#include <optional>
#include <set>
#include <string>
#include <vector>

namespace dgsfm {

// What is read of a database, each with all before it; PAIRS without their
// matches.
enum class SceneContent { IMAGES, FEATURES, PAIRS, MATCHES };

// The images of the database that a scene has.
using ImageNames = std::set<std::string>;

// Loads and validates a scene: indices in range, finite key points, known
// cameras and camera models, no duplicate matches (duplicates are removed).
// Throws std::runtime_error naming the file and the image or pair. The
// database is opened read-only and must exist. Camera models that COLMAP 3.8
// lacks are refused by name.
Scene ReadScene(
    const std::string& database_path,
    SceneContent content = SceneContent::MATCHES,
    SqliteConnection::Mode mode = SqliteConnection::Mode::READ_ONLY);
// The same with at most about max_num_keypoints matched key points an image, 0
// = all: images with more use those that ChooseKeypoints takes for half as many
// matches, and those that these are matched with (Scene::kept_keypoints).
// Memory grows with the images and with the matches of one image, not with all
// matches. With names the scene has these images alone and the pairs between
// them; throws as well if an image does not exist.
Scene ReadPartOfScene(const std::string& database_path,
                      int max_num_keypoints,
                      const std::optional<ImageNames>& names,
                      SceneContent content = SceneContent::MATCHES);

// The key points of one image of the scene [px]; none if it has no row. Throws
// as ReadScene().
std::vector<Eigen::Vector2d> ReadKeypoints(const SqliteConnection& connection,
                                           const colmap::Image& image);

}  // namespace dgsfm
