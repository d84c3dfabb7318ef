// Synthetic scenes of points with exact truth: cameras, poses, key points,
// depth samples and matches, without images. Tests, benchmarks and the
// command depth_scene_synthesizer share them. For scenes with pixels see
// ray_caster.h; conversions to COLMAP's types are in synthetic_scene_io.h.

#pragma once

#include "colmap_ext/rigid3.h"
#include "colmap_ext/synthetic/depth_noise.h"
#include "colmap_ext/synthetic/scene_layout.h"
#include "colmap_ext/synthetic/synthetic_camera.h"
#include "colmap_ext/synthetic/synthetic_rig.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>
#include <colmap/feature/types.h>
#include <colmap/util/types.h>

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct SyntheticSceneOptions {
  int num_images = 20;
  // Key points that show a point, on average over the images.
  int num_points_per_image = 400;
  SceneFamily family = SceneFamily::RING;
  SyntheticCameraOptions camera;
  // Images are those of the cameras of a rig, frame by frame, if there is one;
  // each camera of it then is one of the scene, and those of a cube have square
  // images of 90 degrees.
  SyntheticRig rig = SyntheticRig::NONE;
  // Whether databases and Scenes have the true intrinsics with the prior flag.
  // Otherwise they have COLMAP's guess: 1.2 * max(width, height), undistorted.
  bool known_focal_length = true;
  // Parts of the scene that share no points, each with its own images.
  int num_components = 1;
  // Each coordinate of the centre of a camera, or rig, is off that of the
  // family by up to this, as of a tripod that is not there [m].
  double sway_m = 0;
  // How far these are apart along x [m]; 0 = above each other, out of sight.
  double component_step_m = 0;
  // Standard deviation of key points in x and y [px].
  double image_noise_px = 0;
  // Share of wrong matches, in [0, 1), in each pair.
  double outlier_match_ratio = 0;
  // Share of images, in [0, 1], without depth.
  double no_depth_ratio = 0;
  DepthNoiseOptions depth_noise;
  // Pairs of images with no common view whose matches agree with one wrong
  // pose, as between look-alike buildings.
  int num_false_pairs = 0;
  // In REPEATS and TWINS, such pairs of each image with what looks alike; fewer
  // where there are no such images without common view.
  int max_num_look_alikes = 0;
  // Images are matched if they have at least min_num_matches common points and
  // one is among the neighbours of the other: if there are too many, half are
  // those with most common points, and half are spread over all the others, as
  // crowds would otherwise be matched among themselves only.
  int max_num_neighbors = 20;
  int min_num_matches = 20;
  uint32_t random_seed = 0;

  bool IsValid(std::string* error) const;
};

// What belongs to a family beside its layout, without noise and depth errors:
// look-alikes (REPEATS, TWINS), and photos by everyone (INTERNET): unknown
// cameras of different sizes, formats, focal lengths and distortions, 30 %
// outliers.
SyntheticSceneOptions SceneFamilyOptions(SceneFamily family);

struct SyntheticImage {
  colmap::image_t image_id = colmap::kInvalidImageId;
  std::string name;
  colmap::camera_t camera_id = colmap::kInvalidCameraId;
  int component = 0;
  Rigid3d cam_from_world;  // [m]
  // Origin and pixel centres as in COLMAP [px].
  std::vector<Eigen::Vector2d> keypoints;
  // Index of the point that each key point shows; -1 for clutter.
  std::vector<int> point_idxs;
  // Prior depth at each key point; empty if the image has no depth.
  std::vector<float> prior_depths;
  // Exact depth [m] = depth_scale * prior depth, up to the depth errors.
  double depth_scale = 1;
};

struct SyntheticPair {
  colmap::FeatureMatches matches;  // of image_id1 < image_id2
  // Whether the matches are right; the others are outliers.
  std::vector<bool> is_inlier;
  // The images show different places; inliers agree with cam2_from_cam1,
  // which is not the truth.
  bool is_false = false;
  Rigid3d cam2_from_cam1;  // [m]
};

// Units are metres; the world's z axis points up.
struct SyntheticScene {
  SyntheticSceneOptions options;
  std::map<colmap::camera_t, colmap::Camera> cameras;
  std::map<colmap::image_t, SyntheticImage> images;  // ids from 1
  std::vector<Eigen::Vector3d> points;
  std::map<colmap::image_pair_t, SyntheticPair> pairs;
};

// Draws a scene. The median log scale of the images with depth is zero in
// each component, so that a model in units of the median image is metric.
// Deterministic in the seed; geometry does not change with the noise. Throws
// std::invalid_argument if options are invalid or the scene has fewer pairs
// without common view than num_false_pairs.
SyntheticScene SynthesizeScene(const SyntheticSceneOptions& options);

}  // namespace dgsfm
