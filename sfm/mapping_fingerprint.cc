#include "sfm/mapping_fingerprint.h"

#include "colmap_ext/fnv_hash.h"

namespace dgsfm {

namespace {

// To be raised whenever the mapping gives another result for the same input.
constexpr uint32_t kVersion = 29;

template <typename Matrix>
void AddNumbers(const Matrix& numbers, FnvHash* hash) {
  for (Eigen::Index i = 0; i < numbers.size(); ++i) hash->Add(numbers(i));
}

void AddPose(const Rigid3d& pose, FnvHash* hash) {
  AddNumbers(pose.rotation.coeffs(), hash);
  AddNumbers(pose.translation, hash);
}

void AddCameras(const Scene& scene, FnvHash* hash) {
  hash->Add(scene.cameras.size());
  for (const auto& [camera_id, camera] : scene.cameras) {
    hash->Add(camera_id);
    hash->Add(camera.ModelId());
    hash->Add(camera.Width());
    hash->Add(camera.Height());
    hash->AddAll(camera.Params());
    hash->Add(camera.HasPriorFocalLength());
  }
  hash->Add(scene.exif.size());
  for (const auto& [camera_id, exif] : scene.exif) {
    hash->Add(camera_id);
    hash->AddAll(exif.camera);
    hash->Add(exif.focal_length_ratio);
  }
  hash->Add(scene.focal_priors.size());
  for (const auto& [camera_id, prior] : scene.focal_priors) {
    hash->Add(camera_id);
    hash->Add(prior.focal_px);
    hash->Add(prior.log_stddev);
  }
}

void AddImages(const Scene& scene, FnvHash* hash) {
  hash->Add(scene.images.size());
  for (const auto& [image_id, image] : scene.images) {
    hash->Add(image_id);
    hash->Add(image.CameraId());
    hash->AddAll(image.Name());
    hash->Add(image.NumPoints2D());
    for (const colmap::Point2D& point : image.Points2D()) {
      AddNumbers(point.XY(), hash);
    }
  }
  hash->Add(scene.kept_keypoints.size());
  for (const auto& [image_id, kept] : scene.kept_keypoints) {
    hash->Add(image_id);
    hash->AddAll(kept);
  }
}

void AddRigs(const RigScene& rigs, FnvHash* hash) {
  hash->Add(rigs.rigs.size());
  for (const auto& [rig_id, rig] : rigs.rigs) {
    hash->Add(rig_id);
    hash->Add(rig.ref_camera_id);
    hash->Add(rig.cam_from_rig.size());
    for (const auto& [camera_id, pose] : rig.cam_from_rig) {
      hash->Add(camera_id);
      hash->Add(pose.has_value());
      if (pose) AddPose(*pose, hash);
    }
  }
  hash->Add(rigs.frames.size());
  for (const auto& [frame_id, frame] : rigs.frames) {
    hash->Add(frame_id);
    hash->Add(frame.rig_id);
    hash->Add(frame.images.size());
    for (const auto& [camera_id, image_id] : frame.images) {
      hash->Add(camera_id);
      hash->Add(image_id);
    }
  }
}

void AddPosePriors(const PosePriors& priors, FnvHash* hash) {
  hash->Add(priors.size());
  for (const auto& [image_id, prior] : priors) {
    hash->Add(image_id);
    AddNumbers(prior.position, hash);
    AddNumbers(prior.covariance, hash);
    hash->Add(prior.has_covariance);
    AddNumbers(prior.gravity, hash);
  }
}

void AddDepths(const KeypointDepthMap& depths, FnvHash* hash) {
  hash->Add(depths.size());
  for (const auto& [image_id, image_depths] : depths) {
    hash->Add(image_id);
    hash->Add(static_cast<int>(image_depths.unit));
    hash->Add(image_depths.focal_length_px);
    hash->AddAll(image_depths.depths);
  }
}

// The fingerprint of a pair stands for its matches and all that followed from
// them. Options other than those of the verification may choose key points.
void AddPairs(const PairGeometries& pairs, FnvHash* hash) {
  hash->Add(pairs.size());
  for (const auto& [pair_id, pair] : pairs) {
    hash->Add(pair_id);
    hash->Add(pair.fingerprint);
    hash->Add(static_cast<int>(pair.status));
    hash->Add(pair.num_matches);
    hash->Add(pair.inlier_matches.size());
    AddPose(pair.cam2_from_cam1, hash);
  }
}

}  // namespace

uint64_t MappingFingerprint(const std::string& options_text,
                            const PairScores& pair_scores,
                            const Scene& scene,
                            const KeypointDepthMap& depths,
                            const PairGeometries& pairs) {
  FnvHash hash;
  hash.Add(kVersion);
  hash.AddAll(options_text);
  hash.Add(pair_scores.size());
  for (const auto& [pair_id, score] : pair_scores) {
    hash.Add(pair_id);
    hash.Add(score);
  }
  AddCameras(scene, &hash);
  AddImages(scene, &hash);
  AddRigs(scene.rigs, &hash);
  AddPosePriors(scene.pose_priors, &hash);
  AddDepths(depths, &hash);
  AddPairs(pairs, &hash);
  return hash.Value();
}

}  // namespace dgsfm
