#include "sfm/joining/part_joining.h"

#include "colmap_ext/pose_access.h"
#include "sfm/joining/joined_model.h"

#include <cmath>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;

// Cameras along a ring that look outwards at points around it.
class PartJoining : public testing::Test {
 protected:
  static constexpr int kNumImages = 60;
  static constexpr int kNumPointsPerImage = 30;

  void SetUp() override {
    colmap::Camera camera;
    camera.SetCameraId(1);
    camera.SetModelIdFromName("PINHOLE");
    camera.SetWidth(800);
    camera.SetHeight(600);
    camera.SetParams({600, 600, 400, 300});
    scene_.cameras[1] = camera;
    for (int i = 0; i < kNumImages; ++i) {
      colmap::Image image;
      image.SetImageId(i + 1);
      image.SetCameraId(1);
      image.SetName(std::to_string(i));
      scene_.images.emplace(i + 1, image);
    }
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int i = 0; i < kNumImages * kNumPointsPerImage; ++i) {
      const double angle = Angle(double(i) / kNumPointsPerImage);
      points_.emplace_back((30 + uniform(rng_)) * std::cos(angle),
                           (30 + uniform(rng_)) * std::sin(angle),
                           2 * uniform(rng_));
    }
  }

  static double Angle(double image) { return 2 * M_PI * image / kNumImages; }

  Rigid3d CamFromWorldOf(int image) const {
    const double angle = Angle(image);
    Eigen::Matrix3d rotation;
    rotation.row(0) << -std::sin(angle), std::cos(angle), 0;
    rotation.row(1) << 0, 0, -1;
    rotation.row(2) << -std::cos(angle), -std::sin(angle), 0;
    rotation.row(2) *= -1;
    rotation.row(1) = rotation.row(2).cross(rotation.row(0));
    const Eigen::Vector3d center(
        20 * std::cos(angle), 20 * std::sin(angle), 0.1 * image);
    return {Eigen::Quaterniond(rotation), rotation * -center};
  }

  // Images first to first + count - 1 around the ring, with noise, in a frame
  // of its own.
  PartModel CreatePart(int first, int count) {
    std::normal_distribution<double> normal(0, 1e-3);
    std::uniform_real_distribution<double> uniform(-1, 1);
    Similarity3d part_from_world;
    part_from_world.scale = std::exp(uniform(rng_));
    part_from_world.rotation = Eigen::Quaterniond::UnitRandom();
    part_from_world.translation = Eigen::Vector3d(3, uniform(rng_), 7);
    PartModel part;
    part.name = "part " + std::to_string(first);
    part.cameras = scene_.cameras;
    part.points.resize(points_.size());
    part.colors.resize(points_.size());
    for (int i = first; i < first + count; ++i) {
      const int image = i % kNumImages;
      const Rigid3d pose = CamFromWorldOf(image);
      PartModel::PartImage& added = part.images[image + 1];
      added.camera_id = 1;
      const Eigen::Quaterniond rotation =
          pose.rotation * part_from_world.rotation.conjugate();
      added.cam_from_part = {
          rotation,
          rotation * -(part_from_world * pose.TargetOriginInSource())};
      for (int j = 0; j < 4 * kNumPointsPerImage; ++j) {
        const int point = (image * kNumPointsPerImage + j) %
                          (kNumImages * kNumPointsPerImage);
        added.observations.push_back(
            {colmap::point2D_t(j), uint32_t(point), {1, 1}});
        part.points[point] =
            part_from_world *
            (points_[point] +
             Eigen::Vector3d(normal(rng_), normal(rng_), normal(rng_)));
      }
      added.num_keypoints = added.observations.size();
    }
    return part;
  }

  std::mt19937 rng_;
  Scene scene_;
  std::vector<Eigen::Vector3d> points_;
};

TEST_F(PartJoining, JoinsAllPartsOfARing) {
  std::vector<PartModel> parts;
  for (int i = 0; i < 4; ++i) parts.push_back(CreatePart(15 * i, 20));
  const PartGroups groups = GroupParts({}, {}, parts);
  ASSERT_EQ(groups.groups.size(), 1);
  EXPECT_TRUE(groups.contradictions.empty());
  const JoinedModel model = JoinGroup(scene_, groups.groups[0], &parts);
  EXPECT_EQ(model.poses.NumRegImages(), kNumImages);
  EXPECT_EQ(model.NumPoints(), points_.size());
  for (size_t i = 0; i < model.NumPoints(); ++i) {
    EXPECT_EQ(model.begins[i + 1] - model.begins[i], 4);
  }
  // Distances across the ring over those of neighbours.
  const auto center = [&](int image) {
    return CamFromWorld(model.poses.Image(image + 1)).TargetOriginInSource();
  };
  const double scale = (center(3) - center(2)).norm() /
                       (CamFromWorldOf(3).TargetOriginInSource() -
                        CamFromWorldOf(2).TargetOriginInSource())
                           .norm();
  EXPECT_NEAR((center(30) - center(2)).norm(),
              scale * (CamFromWorldOf(30).TargetOriginInSource() -
                       CamFromWorldOf(2).TargetOriginInSource())
                          .norm(),
              0.05 * scale);
}

// Images of their own entries that a part gives one focal length have one
// camera, and through images in both parts that of the other part, too.
TEST_F(PartJoining, EntriesThatPartsTiedShareTheirMean) {
  for (int i = 0; i < kNumImages; ++i) {
    colmap::Camera camera = scene_.cameras.at(1);
    camera.SetCameraId(i + 1);
    scene_.cameras[i + 1] = camera;
    scene_.images.at(i + 1).SetCameraId(i + 1);
  }
  std::vector<PartModel> parts = {CreatePart(0, 20), CreatePart(10, 20)};
  for (size_t i = 0; i < parts.size(); ++i) {
    for (auto& [image_id, image] : parts[i].images) {
      image.camera_id = image_id;
      colmap::Camera& camera = parts[i].cameras[image_id];
      camera.SetFocalLengthX(image_id == 3 ? 500 : 590 + 20 * double(i));
    }
  }
  const PartGroups groups = GroupParts({}, {}, parts);
  ASSERT_EQ(groups.groups.size(), 1);
  const JoinedModel model = JoinGroup(scene_, groups.groups[0], &parts);
  for (const auto& [camera_id, camera] : model.poses.Cameras()) {
    // Image 3 has a camera of its own; parts have as many observations.
    EXPECT_NEAR(camera.FocalLengthX(), camera_id == 3 ? 500 : 600, 1);
  }
}

// Positions bring a row of parts to their frame, and hold it.
TEST_F(PartJoining, UsesPositions) {
  std::vector<PartModel> parts;
  for (int i = 0; i < 5; ++i) parts.push_back(CreatePart(10 * i, 15));
  PosePriors positions;
  std::normal_distribution<double> normal(0, 0.1);
  for (int i = 0; i < kNumImages; ++i) {
    PosePrior& prior = positions[i + 1];
    prior.position = CamFromWorldOf(i).TargetOriginInSource() +
                     Eigen::Vector3d(normal(rng_), normal(rng_), normal(rng_));
    prior.covariance = 0.01 * Eigen::Matrix3d::Identity();
  }
  const PartGroups groups = GroupParts({}, positions, parts);
  ASSERT_EQ(groups.groups.size(), 1);
  const JoinedModel model = JoinGroup(scene_, groups.groups[0], &parts);
  const auto from_positions = [&](int image) {
    return (CamFromWorld(model.poses.Image(image + 1)).rotation *
            CamFromWorldOf(image).rotation.conjugate())
               .angularDistance(Eigen::Quaterniond::Identity()) *
           180 / M_PI;
  };
  // The scale is the median of the parts', so that rotations are compared.
  // Positions of fifteen images on an arc of 20 m hold them to 0.3 degrees.
  for (const int image : {0, 27, 54}) EXPECT_LT(from_positions(image), 1);
}

// Wrong positions, such as those of other images, do not part a model.
TEST_F(PartJoining, PartsWithWrongPositionsAreJoined) {
  std::vector<PartModel> parts;
  for (int i = 0; i < 5; ++i) parts.push_back(CreatePart(10 * i, 15));
  PosePriors positions;
  for (int i = 0; i < kNumImages; ++i) {
    PosePrior& prior = positions[i + 1];
    const int other = i % 10 == 0 ? i : (7 * i) % kNumImages;
    prior.position = (i < 30 ? 1 : 2) *
                     CamFromWorldOf(i < 30 ? i : other).TargetOriginInSource();
    prior.covariance = 1e-4 * Eigen::Matrix3d::Identity();
  }
  EXPECT_EQ(GroupParts({}, positions, parts).groups.size(), 1);
}

TEST_F(PartJoining, PartsWithoutSharedImagesStayApart) {
  const std::vector<PartModel> parts = {CreatePart(0, 20), CreatePart(25, 15)};
  const PartGroups groups = GroupParts({}, {}, parts);
  ASSERT_EQ(groups.groups.size(), 2);
  EXPECT_EQ(groups.groups[0].parts, std::vector<int>{0});
  EXPECT_TRUE(groups.contradictions.empty());
}

// False pairs fold a model: half of its images are in another place.
TEST_F(PartJoining, APoisonedPartStaysAModelOfItsOwn) {
  std::vector<PartModel> parts;
  for (int i = 0; i < 6; ++i) parts.push_back(CreatePart(10 * i, 25));
  PartModel& poisoned = parts[2];
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitX()));
  for (auto& [image_id, image] : poisoned.images) {
    if (image_id < 33) continue;
    image.cam_from_part.rotation = image.cam_from_part.rotation * turn;
  }
  for (size_t i = 32 * kNumPointsPerImage; i < poisoned.points.size(); ++i) {
    poisoned.points[i] = turn.conjugate() * poisoned.points[i];
  }
  const PartGroups groups = GroupParts({}, {}, parts);
  ASSERT_EQ(groups.groups.size(), 2);
  EXPECT_EQ(groups.groups[0].parts, (std::vector<int>{0, 1, 3, 4, 5}));
  EXPECT_EQ(groups.groups[1].parts, std::vector<int>{2});
  ASSERT_FALSE(groups.contradictions.empty());
  for (const std::string& contradiction : groups.contradictions) {
    EXPECT_THAT(contradiction, HasSubstr("part 20"));
  }
  // The others are where they are without it.
  const JoinedModel model = JoinGroup(scene_, groups.groups[0], &parts);
  EXPECT_EQ(model.image_ids.size(), kNumImages);
}

}  // namespace
}  // namespace dgsfm
