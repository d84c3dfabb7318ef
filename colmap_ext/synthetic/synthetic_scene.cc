#include "colmap_ext/synthetic/synthetic_scene.h"

#include "colmap_ext/check.h"
#include "colmap_ext/synthetic/scene_matcher.h"
#include "colmap_ext/synthetic/scene_points.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numeric>
#include <utility>

namespace dgsfm {

namespace {

enum Purpose : uint32_t {
  POINTS = 0,
  POSES = 1,
  KEYPOINT_ORDER = 2,
  IMAGE_NOISE = 3,
  CLUTTER = 4,
  CLUTTER_DEPTH = 5,
  NO_DEPTH = 7,
  FALSE_PAIRS = 8,
};

// Components lie above each other, out of sight [m].
constexpr double kComponentDistance = 1000;

class Synthesizer {
 public:
  explicit Synthesizer(const SyntheticSceneOptions& options)
      : cams_from_rig_(CamsFromRig(options.rig)) {
    scene_.options = options;
    if (options.rig == SyntheticRig::NONE) return;
    SyntheticCameraOptions& camera = scene_.options.camera;
    camera.num_cameras = int(cams_from_rig_.size());
    if (options.rig == SyntheticRig::CUBE) {
      camera.width_px = camera.height_px;
      camera.focal_length_px = camera.height_px / 2.0;
    }
  }

  SyntheticScene Run() {
    scene_.cameras = SynthesizeCameras(
        Options().camera, Options().num_images, Options().random_seed);
    const std::vector<Component> components = CreateComponents();
    for (const Component& component : components) DrawImages(component);
    ScenePoints points(&scene_);
    for (const Component& component : components) {
      RandomStream random = Random(POINTS, component.index);
      points.Draw(*component.layout,
                  component.origin,
                  component.num_images,
                  Options().num_points_per_image,
                  &random);
    }
    std::vector<FalsePair> false_pairs;
    if (Options().num_false_pairs > 0) {
      RandomStream random = Random(FALSE_PAIRS);
      false_pairs = points.AddFalsePairs(
          Options().num_false_pairs, Options().min_num_matches, &random);
    }
    ShuffleKeypoints();
    AddClutterAndNoise();
    AddDepth();
    SceneMatcher(points, &scene_).Match(false_pairs);
    return std::move(scene_);
  }

 private:
  // A part of the scene that shares nothing with the others.
  struct Component {
    int index;
    int first_image;  // from 0
    int num_images;
    Eigen::Vector3d origin;
    std::unique_ptr<SceneLayout> layout;
  };

  const SyntheticSceneOptions& Options() const { return scene_.options; }
  RandomStream Random(Purpose purpose,
                      uint32_t index1 = 0,
                      uint32_t index2 = 0) const {
    return RandomStream(Options().random_seed, purpose, index1, index2);
  }

  std::vector<Component> CreateComponents() const;
  void DrawImages(const Component& component);
  void ShuffleKeypoints();
  void AddClutterAndNoise();
  void AddDepth();
  DepthSamples TrueDepths(const SyntheticImage& image) const;

  const std::vector<Rigid3d> cams_from_rig_;
  SyntheticScene scene_;
};

std::vector<Synthesizer::Component> Synthesizer::CreateComponents() const {
  const SyntheticSceneOptions& options = Options();
  std::vector<Component> components;
  for (int i = 0; i < options.num_components; ++i) {
    const int begin = i * options.num_images / options.num_components;
    const int end = (i + 1) * options.num_images / options.num_components;
    components.push_back(
        {i,
         begin,
         end - begin,
         options.component_step_m > 0
             ? Eigen::Vector3d(options.component_step_m * i, 0, 0)
             : Eigen::Vector3d(0, 0, kComponentDistance * i),
         CreateSceneLayout(options.family,
                           (end - begin) / int(cams_from_rig_.size()))});
  }
  return components;
}

void Synthesizer::DrawImages(const Component& component) {
  for (int i = 0; i < component.num_images; ++i) {
    const int image_idx = component.first_image + i;
    SyntheticImage image;
    image.image_id = image_idx + 1;
    const int num_cams = int(cams_from_rig_.size());
    const int cam = image_idx % num_cams;
    char name[64];
    if (num_cams == 1) {
      std::snprintf(name, sizeof(name), "image%04d.jpg", image_idx);
    } else {
      std::snprintf(
          name, sizeof(name), "cam%d/image%04d.jpg", cam, image_idx / num_cams);
    }
    image.name = name;
    image.camera_id = 1 + image_idx % scene_.cameras.size();
    image.component = component.index;
    // Images of a frame draw the same pose.
    RandomStream random = Random(POSES, image.image_id - cam);
    const Rigid3d rig_from_world =
        DrawPose(*component.layout, i / num_cams, &random);
    Eigen::Vector3d sway = Eigen::Vector3d::Zero();
    if (Options().sway_m > 0) {
      for (double& offset : sway) {
        offset = Options().sway_m * random.Uniform(-1, 1);
      }
    }
    image.cam_from_world =
        cams_from_rig_[cam] * rig_from_world *
        Rigid3d(Eigen::Quaterniond::Identity(), -component.origin - sway);
    scene_.images.emplace(image.image_id, image);
  }
}

// No stage may profit from equal order in all images.
void Synthesizer::ShuffleKeypoints() {
  for (auto& [image_id, image] : scene_.images) {
    std::vector<size_t> order(image.keypoints.size());
    std::iota(order.begin(), order.end(), 0);
    Random(KEYPOINT_ORDER, image_id).Shuffle(&order);
    const SyntheticImage ordered = image;
    for (size_t i = 0; i < order.size(); ++i) {
      image.keypoints[i] = ordered.keypoints[order[i]];
      image.point_idxs[i] = ordered.point_idxs[order[i]];
    }
  }
}

void Synthesizer::AddClutterAndNoise() {
  const SyntheticSceneOptions& options = Options();
  // Enough for all outliers of a pair to be clutter.
  const double clutter_ratio =
      options.outlier_match_ratio / (1 - options.outlier_match_ratio);
  for (auto& [image_id, image] : scene_.images) {
    const Eigen::Vector2d size = ImageSize(scene_.cameras.at(image.camera_id));
    RandomStream noise_random = Random(IMAGE_NOISE, image_id);
    for (Eigen::Vector2d& xy : image.keypoints) {
      const Eigen::Vector2d noise{noise_random.Normal(), noise_random.Normal()};
      xy += options.image_noise_px * noise;
      xy = xy.cwiseMax(Eigen::Vector2d::Zero()).cwiseMin(size);
    }
    RandomStream random = Random(CLUTTER, image_id);
    const size_t num_clutter =
        std::ceil(clutter_ratio * image.keypoints.size());
    for (size_t i = 0; i < num_clutter; ++i) {
      const double x = random.Uniform(0, size.x());
      image.keypoints.emplace_back(x, random.Uniform(0, size.y()));
      image.point_idxs.push_back(-1);
    }
  }
}

void Synthesizer::AddDepth() {
  const SyntheticSceneOptions& options = Options();
  std::vector<colmap::image_t> ids(options.num_images);
  std::iota(ids.begin(), ids.end(), 1);
  Random(NO_DEPTH).Shuffle(&ids);
  ids.resize(std::lround((1 - options.no_depth_ratio) * ids.size()));
  std::sort(ids.begin(), ids.end());
  std::map<int, std::vector<colmap::image_t>> ids_of_component;
  for (const colmap::image_t image_id : ids) {
    ids_of_component[scene_.images.at(image_id).component].push_back(image_id);
  }
  for (const auto& [component, image_ids] : ids_of_component) {
    const std::vector<double> scales =
        SynthesizeDepthScales(options.depth_noise.log_scale_stddev,
                              image_ids.size(),
                              options.random_seed + component);
    for (size_t i = 0; i < image_ids.size(); ++i) {
      scene_.images.at(image_ids[i]).depth_scale = scales[i];
    }
  }
  for (const colmap::image_t image_id : ids) {
    SyntheticImage& image = scene_.images.at(image_id);
    image.prior_depths = SynthesizePriorDepths(options.depth_noise,
                                               image.depth_scale,
                                               TrueDepths(image),
                                               options.random_seed,
                                               image_id);
  }
}

DepthSamples Synthesizer::TrueDepths(const SyntheticImage& image) const {
  DepthSamples samples;
  samples.image_size_px = ImageSize(scene_.cameras.at(image.camera_id));
  samples.xys_px = image.keypoints;
  RandomStream random = Random(CLUTTER_DEPTH, image.image_id);
  const size_t num_observed = std::count_if(
      image.point_idxs.begin(), image.point_idxs.end(), [](int point_idx) {
        return point_idx >= 0;
      });
  for (size_t i = 0; i < image.keypoints.size(); ++i) {
    // Clutter, which follows the points, has the depth of any of them.
    const int point_idx =
        image.point_idxs[i < num_observed ? i : random.Index(num_observed)];
    samples.depths.push_back(
        (image.cam_from_world * scene_.points[point_idx]).z());
  }
  return samples;
}

}  // namespace

bool SyntheticSceneOptions::IsValid(std::string* error) const {
  const auto check = [error](const char* name, double value, double min) {
    if (value >= min) return true;
    *error = std::string(name) + " = " + std::to_string(value) +
             " must be at least " + std::to_string(min);
    return false;
  };
  const auto check_ratio = [error](const char* name, double value) {
    if (value >= 0 && value < 1) return true;
    *error = std::string(name) + " = " + std::to_string(value) +
             " must be in [0, 1)";
    return false;
  };
  // What one machine can hold, by far.
  const auto check_count = [&](const char* name, int value, int min) {
    constexpr int kMaxCount = 1000000;
    if (value <= kMaxCount) return check(name, value, min);
    *error = std::string(name) + " = " + std::to_string(value) +
             " must be at most " + std::to_string(kMaxCount);
    return false;
  };
  const auto check_frames = [&] {
    const int num_cams = int(CamsFromRig(rig).size());
    if (num_cams == 1 || num_images % (num_cams * num_components) == 0) {
      return true;
    }
    *error = "num_images = " + std::to_string(num_images) +
             " must be a multiple of the cameras of the rig and the components";
    return false;
  };
  return check_count("num_images", num_images, 1) &&
         check_count("num_points_per_image", num_points_per_image, 1) &&
         check("num_components", num_components, 1) &&
         check("num_images", num_images, num_components) &&
         check("component_step_m", component_step_m, 0) &&
         check("sway_m", sway_m, 0) &&
         check("image_noise_px", image_noise_px, 0) &&
         check("num_false_pairs", num_false_pairs, 0) &&
         check("max_num_look_alikes", max_num_look_alikes, 0) &&
         check("max_num_neighbors", max_num_neighbors, 1) &&
         check("min_num_matches", min_num_matches, 1) &&
         check_ratio("outlier_match_ratio", outlier_match_ratio) &&
         check_ratio("no_depth_ratio", no_depth_ratio) && check_frames() &&
         camera.IsValid(error) && depth_noise.IsValid(error);
}

SyntheticSceneOptions SceneFamilyOptions(SceneFamily family) {
  SyntheticSceneOptions options;
  options.family = family;
  if (family == SceneFamily::REPEATS) {
    options.max_num_look_alikes = 1;
  } else if (family == SceneFamily::TWINS) {
    options.max_num_look_alikes = 5;
  } else if (family == SceneFamily::INTERNET) {
    options.camera.num_cameras = 0;
    options.camera.max_log_focal_offset = 0.35;
    options.camera.max_log_size_offset = 0.3;
    options.camera.max_distortion_offset = 0.08;
    options.camera.portrait_ratio = 0.3;
    options.known_focal_length = false;
    options.outlier_match_ratio = 0.3;
  }
  return options;
}

SyntheticScene SynthesizeScene(const SyntheticSceneOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  return Synthesizer(options).Run();
}

}  // namespace dgsfm
