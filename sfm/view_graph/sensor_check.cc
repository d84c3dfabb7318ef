#include "sfm/view_graph/sensor_check.h"

#include "estimators/averaging/median_rotation.h"
#include "estimators/median.h"
#include "estimators/optimization/ray_intersection.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <map>
#include <optional>
#include <sstream>
#include <utility>

#include <Eigen/SVD>

namespace dgsfm {

namespace {

// Comparisons of two cameras from which they count, and up to which they are
// made.
constexpr size_t kMinNumComparisons = 5;
constexpr size_t kMaxNumComparisons = 1000;
// Errors of rotations up to which they agree [deg]; wrong focal lengths make
// the angle between cameras wrong by about their own relative error.
constexpr double kMaxRotationErrorDeg = 5;
constexpr double kUnknownFocalError = 0.1;
// Directions of motion are less certain: focal lengths and the distance of the
// cameras change them. They differ by a rotation of the camera if that takes
// away most of the difference.
constexpr double kMaxDirectionErrorDeg = 10;
constexpr double kMaxShareLeft = 0.4;
// Rotation between frames up to which the distance of the cameras hardly
// changes the direction, and from which the rotation has an axis [deg].
constexpr double kTurnDeg = 5;
constexpr int kNumAlignmentRounds = 5;

using SensorPair = std::pair<colmap::camera_t, colmap::camera_t>;

double DegFromRad(double angle_rad) { return angle_rad * 180 / M_PI; }

// The same direction as two cameras see it.
struct SharedDirection {
  Eigen::Vector3d in_cam1;
  Eigen::Vector3d in_cam2;
};

// What pairs show of the relative poses of two cameras, the smaller id first.
struct SensorComparisons {
  std::vector<Eigen::Quaterniond> cam2_from_cam1;
  // Axes of rotation, and translations, of both from one frame to another.
  std::vector<SharedDirection> motions;
};

using Comparisons = std::map<SensorPair, SensorComparisons>;

// A valid pair seen from one of its images.
struct Neighbor {
  const FrameMember* member = nullptr;
  Eigen::Quaterniond neighbor_from_image;
};

void AddRotation(const FrameMember& member1,
                 const FrameMember& member2,
                 const Eigen::Quaterniond& cam2_from_cam1,
                 Comparisons* comparisons) {
  if (member1.camera_id > member2.camera_id) {
    AddRotation(member2, member1, cam2_from_cam1.conjugate(), comparisons);
    return;
  }
  auto& rotations =
      (*comparisons)[{member1.camera_id, member2.camera_id}].cam2_from_cam1;
  if (rotations.size() < kMaxNumComparisons) {
    rotations.push_back(cam2_from_cam1);
  }
}

// A valid pair and where its images are in frames, null for one in none.
struct MemberPair {
  colmap::image_t image_id1 = colmap::kInvalidImageId;
  colmap::image_t image_id2 = colmap::kInvalidImageId;
  const FrameMember* member1 = nullptr;
  const FrameMember* member2 = nullptr;
  const PairGeometry* pair = nullptr;
};

std::vector<MemberPair> ValidPairsOf(const FrameMembers& members,
                                     const PairGeometries& pairs) {
  const auto member_of = [&](colmap::image_t image_id) {
    const auto member = members.find(image_id);
    return member == members.end() ? nullptr : &member->second;
  };
  std::vector<MemberPair> valid;
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    valid.push_back({image_id1,
                     image_id2,
                     member_of(image_id1),
                     member_of(image_id2),
                     &pair});
  }
  return valid;
}

// Rotations by pairs within frames, and by two pairs of a third image.
void CompareRotations(const std::vector<MemberPair>& pairs,
                      Comparisons* comparisons) {
  std::map<std::pair<colmap::image_t, frame_t>, std::vector<Neighbor>>
      neighbors;
  for (const auto& [image_id1, image_id2, member1, member2, pair] : pairs) {
    const Eigen::Quaterniond& rotation = pair->cam2_from_cam1.rotation;
    if (member1 && member2 && member1->frame_id == member2->frame_id) {
      AddRotation(*member1, *member2, rotation, comparisons);
      continue;
    }
    if (member2) {
      neighbors[{image_id1, member2->frame_id}].push_back({member2, rotation});
    }
    if (member1) {
      neighbors[{image_id2, member1->frame_id}].push_back(
          {member1, rotation.conjugate()});
    }
  }
  for (const auto& [key, images] : neighbors) {
    for (size_t i = 0; i < images.size(); ++i) {
      for (size_t j = 0; j < i; ++j) {
        AddRotation(*images[i].member,
                    *images[j].member,
                    images[j].neighbor_from_image *
                        images[i].neighbor_from_image.conjugate(),
                    comparisons);
      }
    }
  }
}

// The axis of the rotation of a camera and, if it hardly turns, the direction
// in which it moves.
struct Motion {
  std::optional<Eigen::Vector3d> axis;
  std::optional<Eigen::Vector3d> direction;
};

Motion MotionOf(const Rigid3d& cam2_from_cam1, bool is_rotation_only) {
  Motion motion;
  const Eigen::AngleAxisd turn(cam2_from_cam1.rotation);
  const double turn_deg = DegFromRad(turn.angle());
  if (turn_deg >= kTurnDeg) motion.axis = turn.axis();
  if (turn_deg <= kTurnDeg && !is_rotation_only &&
      cam2_from_cam1.translation.norm() > 0) {
    motion.direction = cam2_from_cam1.translation.normalized();
  }
  return motion;
}

// Motions of cameras between the same two frames.
void CompareMotions(const std::vector<MemberPair>& pairs,
                    Comparisons* comparisons) {
  std::map<std::pair<frame_t, frame_t>, std::map<colmap::camera_t, Motion>>
      motions;
  for (const auto& [image_id1, image_id2, member1, member2, pair] : pairs) {
    if (!member1 || !member2 || member1->camera_id != member2->camera_id) {
      continue;
    }
    const std::pair<frame_t, frame_t> frames =
        std::minmax(member1->frame_id, member2->frame_id);
    motions[frames][member1->camera_id] = MotionOf(
        frames.first == member1->frame_id ? pair->cam2_from_cam1
                                          : pair->cam2_from_cam1.Inverse(),
        pair->Has(PairDegeneracy::ROTATION_ONLY));
  }
  for (const auto& [frames, cameras] : motions) {
    for (auto camera2 = cameras.begin(); camera2 != cameras.end(); ++camera2) {
      for (auto camera1 = cameras.begin(); camera1 != camera2; ++camera1) {
        auto& directions =
            (*comparisons)[{camera1->first, camera2->first}].motions;
        if (directions.size() >= kMaxNumComparisons) continue;
        const Motion& motion1 = camera1->second;
        const Motion& motion2 = camera2->second;
        if (motion1.axis && motion2.axis) {
          directions.push_back({*motion1.axis, *motion2.axis});
        }
        if (motion1.direction && motion2.direction) {
          directions.push_back({*motion1.direction, *motion2.direction});
        }
      }
    }
  }
}

double MedianErrorDeg(const std::vector<SharedDirection>& directions,
                      const Eigen::Matrix3d& cam2_from_cam1) {
  std::vector<double> errors_deg;
  for (const SharedDirection& direction : directions) {
    errors_deg.push_back(
        AngleDeg(cam2_from_cam1 * direction.in_cam1, direction.in_cam2));
  }
  return Median(errors_deg);
}

// Rotation that fits the directions best, by reweighted least squares of the
// orthogonal Procrustes problem.
Eigen::Matrix3d AlignDirections(
    const std::vector<SharedDirection>& directions) {
  Eigen::Matrix3d cam2_from_cam1 = Eigen::Matrix3d::Identity();
  for (int round = 0; round < kNumAlignmentRounds; ++round) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const SharedDirection& direction : directions) {
      const double error_deg =
          AngleDeg(cam2_from_cam1 * direction.in_cam1, direction.in_cam2);
      const double weight = round == 0 ? 1 : 1 / (1 + error_deg);
      sum += weight * direction.in_cam2 * direction.in_cam1.transpose();
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(
        sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Eigen::Matrix3d product = svd.matrixU() * svd.matrixV().transpose();
    const Eigen::Vector3d signs(1, 1, product.determinant() < 0 ? -1 : 1);
    cam2_from_cam1 =
        svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  }
  return cam2_from_cam1;
}

// How far two cameras are from the poses that their rig gives them.
struct Judgement {
  bool contradicts = false;
  double error_deg = 0;
  bool by_motion = false;
  size_t num_comparisons = 0;
};

Judgement JudgeRotation(const std::vector<Eigen::Quaterniond>& rotations,
                        const Eigen::Quaterniond& cam2_from_cam1,
                        double focal_error) {
  const Eigen::Quaterniond median = MedianRotation(rotations);
  std::vector<double> spread_deg;
  for (const Eigen::Quaterniond& rotation : rotations) {
    spread_deg.push_back(DegFromRad(rotation.angularDistance(median)));
  }
  const double angle_deg =
      DegFromRad(median.angularDistance(Eigen::Quaterniond::Identity()));
  Judgement judgement;
  judgement.num_comparisons = rotations.size();
  judgement.error_deg = DegFromRad(cam2_from_cam1.angularDistance(median));
  judgement.contradicts =
      judgement.error_deg >
      std::max(
          {kMaxRotationErrorDeg, focal_error * angle_deg, Median(spread_deg)});
  return judgement;
}

Judgement JudgeMotions(const std::vector<SharedDirection>& motions,
                       const Eigen::Quaterniond& cam2_from_cam1) {
  Judgement judgement;
  judgement.by_motion = true;
  judgement.num_comparisons = motions.size();
  judgement.error_deg =
      MedianErrorDeg(motions, cam2_from_cam1.toRotationMatrix());
  judgement.contradicts = judgement.error_deg > kMaxDirectionErrorDeg &&
                          MedianErrorDeg(motions, AlignDirections(motions)) <
                              kMaxShareLeft * judgement.error_deg;
  return judgement;
}

std::optional<Judgement> Judge(const SensorComparisons& comparisons,
                               const Eigen::Quaterniond& cam2_from_cam1,
                               double focal_error) {
  if (comparisons.cam2_from_cam1.size() >= kMinNumComparisons) {
    return JudgeRotation(
        comparisons.cam2_from_cam1, cam2_from_cam1, focal_error);
  }
  if (comparisons.motions.size() < kMinNumComparisons) return std::nullopt;
  return JudgeMotions(comparisons.motions, cam2_from_cam1);
}

std::map<SensorPair, Judgement> JudgeSensors(const Scene& scene,
                                             const Rig& rig,
                                             const Comparisons& comparisons) {
  std::map<SensorPair, Judgement> judgements;
  for (const auto& [camera_ids, comparison] : comparisons) {
    const auto pose1 = rig.cam_from_rig.find(camera_ids.first);
    const auto pose2 = rig.cam_from_rig.find(camera_ids.second);
    if (pose1 == rig.cam_from_rig.end() || pose2 == rig.cam_from_rig.end() ||
        camera_ids.first == camera_ids.second) {
      continue;
    }
    const bool are_known =
        scene.cameras.at(camera_ids.first).HasPriorFocalLength() &&
        scene.cameras.at(camera_ids.second).HasPriorFocalLength();
    const std::optional<Judgement> judgement =
        Judge(comparison,
              pose2->second->rotation * pose1->second->rotation.conjugate(),
              are_known ? 0 : kUnknownFocalError);
    if (judgement) judgements[camera_ids] = *judgement;
  }
  return judgements;
}

// The camera that contradicts most others, the reference aside.
std::optional<colmap::camera_t> MostContradicted(
    const std::map<SensorPair, Judgement>& judgements,
    colmap::camera_t ref_camera_id) {
  std::map<colmap::camera_t, int> balance;
  std::map<colmap::camera_t, int> num_contradictions;
  for (const auto& [camera_ids, judgement] : judgements) {
    for (const colmap::camera_t id : {camera_ids.first, camera_ids.second}) {
      if (id == ref_camera_id) continue;
      num_contradictions[id] += judgement.contradicts;
      balance[id] += judgement.contradicts ? 1 : -1;
    }
  }
  std::optional<colmap::camera_t> worst;
  for (const auto& [id, count] : num_contradictions) {
    if (count > 0 && (!worst || balance[id] > balance[*worst])) worst = id;
  }
  return worst;
}

// Takes the judgements of a camera out, by that which rests on most comparisons
// of those that contradict it.
ContradictedSensor TakeOut(colmap::camera_t camera_id,
                           std::map<SensorPair, Judgement>* judgements) {
  ContradictedSensor sensor;
  sensor.camera_id = camera_id;
  size_t max_num_comparisons = 0;
  for (auto it = judgements->begin(); it != judgements->end();) {
    const auto& [camera_ids, judgement] = *it;
    if (camera_ids.first != camera_id && camera_ids.second != camera_id) {
      ++it;
      continue;
    }
    if (judgement.contradicts &&
        judgement.num_comparisons > max_num_comparisons) {
      max_num_comparisons = judgement.num_comparisons;
      sensor.error_deg = judgement.error_deg;
      sensor.by_motion = judgement.by_motion;
      sensor.other_camera_id =
          camera_ids.first == camera_id ? camera_ids.second : camera_ids.first;
    }
    it = judgements->erase(it);
  }
  return sensor;
}

std::string DescribeSensor(const ContradictedSensor& sensor) {
  std::ostringstream text;
  text << std::setprecision(3) << "The pose of camera " << sensor.camera_id
       << " in its rig contradicts the pairs of its images: the "
       << (sensor.by_motion ? "direction of its motion, against that of"
                            : "rotation between it and")
       << " camera " << sensor.other_camera_id << " is off by "
       << sensor.error_deg << " degrees";
  return text.str();
}

}  // namespace

std::vector<ContradictedSensor> FindContradictedSensors(
    const Scene& scene, const PairGeometries& pairs) {
  const FrameMembers members = MembersOf(scene.rigs);
  std::vector<ContradictedSensor> contradicted;
  if (members.empty()) return contradicted;
  const std::vector<MemberPair> valid_pairs = ValidPairsOf(members, pairs);
  Comparisons comparisons;
  CompareRotations(valid_pairs, &comparisons);
  CompareMotions(valid_pairs, &comparisons);
  for (const auto& [rig_id, rig] : scene.rigs.rigs) {
    auto judgements = JudgeSensors(scene, rig, comparisons);
    while (const auto camera_id =
               MostContradicted(judgements, rig.ref_camera_id)) {
      contradicted.push_back(TakeOut(*camera_id, &judgements));
    }
  }
  return contradicted;
}

void DropContradictedSensors(const PairGeometries& pairs,
                             Scene* scene,
                             MappingLog* log) {
  for (const ContradictedSensor& sensor :
       FindContradictedSensors(*scene, pairs)) {
    for (auto& [rig_id, rig] : scene->rigs.rigs) {
      const auto pose = rig.cam_from_rig.find(sensor.camera_id);
      if (pose != rig.cam_from_rig.end()) pose->second.reset();
    }
    log->Warn(DescribeSensor(sensor) +
              ". It is not used, but estimated where images of both cameras "
              "are in one model. Check that it maps from the rig to the "
              "camera, not back, and that the images are those of the camera");
  }
}

}  // namespace dgsfm
