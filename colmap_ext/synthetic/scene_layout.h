// Families of synthetic scenes: where their surfaces are and where the images
// are taken. Distances [m] are chosen for fields of view of about 60 degrees.

#pragma once

#include "colmap_ext/rigid3.h"
#include "colmap_ext/synthetic/random_stream.h"

#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

enum class SceneFamily {
  RING,          // around an object, looking at it; one loop
  STREET,        // along a street, looking ahead, 1.5 m per image
  FACADE,        // a grid of viewpoints before a facade
  CLUSTERS,      // two facades that two images join
  REPEATS,       // along a facade of bays that look alike
  TWINS,         // around a building whose front and back are the same
  LOW_PARALLAX,  // turning by 10 degrees and moving by 10 cm per image
  PANORAMA,      // turning once around without moving
  FORWARD,       // along the axis of a corridor and of the camera, 0.5 m each
  INTERNET,      // crowds before landmarks, near and far, from all sides
};

// Name as on the command line ("low_parallax"), and back; throws
// std::runtime_error on an unknown name.
std::string SceneFamilyName(SceneFamily family);
SceneFamily SceneFamilyFromName(const std::string& name);
// All names, for help and messages: "ring, street, ... or internet".
std::string SceneFamilyNames();
std::vector<SceneFamily> AllSceneFamilies();

// A patch of a surface that may become a key point. It is seen from up to 60
// degrees off its normal, at distances [m] at which features of its size are
// found.
struct SurfacePoint {
  Eigen::Vector3d xyz;     // [m]
  Eigen::Vector3d normal;  // unit
  double min_distance = 0.5;
  double max_distance = 40;
};

// A viewpoint before the photographer's hand moves it: each coordinate of
// center and target by up to its jitter [m].
struct Viewpoint {
  Eigen::Vector3d center;
  Eigen::Vector3d target;
  double center_jitter = 0.3;
  double target_jitter = 0.5;
};

// Surfaces and viewpoints of one scene; the world's z axis points up. Scenes
// grow with their images, so that a point is seen by tens of images at most
// sizes.
class SceneLayout {
 public:
  virtual ~SceneLayout() = default;

  // One point, or the points that look alike: then each is moved by the same
  // rigid motion against the one before.
  virtual std::vector<SurfacePoint> DrawPoints(RandomStream* random) const = 0;
  // Viewpoint of image i from 0.
  virtual Viewpoint DrawViewpoint(int i, RandomStream* random) const = 0;
};

std::unique_ptr<SceneLayout> CreateSceneLayout(SceneFamily family,
                                               int num_images);

// Pose of image i: hand-held, rolled by up to three degrees.
Rigid3d DrawPose(const SceneLayout& layout, int i, RandomStream* random);

}  // namespace dgsfm
