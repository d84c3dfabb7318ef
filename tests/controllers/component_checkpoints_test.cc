#include "controllers/component_checkpoints.h"

#include "colmap_ext/model/model_writer.h"
#include "colmap_ext/synthetic/synthetic_scene_io.h"
#include "sfm/global_mapping.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

std::string Content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Counts what is found and kept, and breaks the run off once it has kept
// enough.
class CountingStore : public ComponentStore {
 public:
  CountingStore(const std::string& path, uint64_t key, int max_num_kept = 100)
      : checkpoints_(path, key), max_num_kept_(max_num_kept) {}

  std::optional<MappedComponent> Find(const ImageIds& image_ids) override {
    auto component = checkpoints_.Find(image_ids);
    num_found += component.has_value();
    return component;
  }
  void Keep(const ImageIds& image_ids,
            const MappedComponent& component) override {
    checkpoints_.Keep(image_ids, component);
    if (++num_kept == max_num_kept_) throw std::runtime_error("broken off");
  }

  int num_found = 0;
  int num_kept = 0;

 private:
  ComponentCheckpoints checkpoints_;
  const int max_num_kept_;
};

class ComponentCheckpointsTest : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    SyntheticSceneOptions options;
    options.num_images = 24;
    options.num_points_per_image = 150;
    options.num_components = 3;
    options.known_focal_length = false;
    options.camera.num_cameras = 0;
    const SyntheticScene synthetic = SynthesizeScene(options);
    scene_ = SceneFromSynthetic(synthetic);
    depths_ = KeypointDepthsFromSynthetic(synthetic);
    verification_.num_threads = 1;
    pairs_ = VerifyPairs(scene_, depths_, verification_);
  }

  // The files of the models and the verdicts, as one text.
  std::string Map(ComponentStore* store) const {
    Scene scene = scene_;
    KeypointDepthMap depths = depths_;
    PairGeometries pairs = pairs_;
    DepthGlobalMapperOptions options;
    options.measure_repeatability = true;
    const DepthGlobalMapperResult result = RunGlobalMapping(
        options, verification_, PairScores(), &scene, &depths, &pairs, store);
    std::string text;
    for (const auto& model : result.models) {
      WriteModel(*model, dir_);
      for (const char* file : {"cameras.bin", "images.bin", "points3D.bin"}) {
        text += Content(fs::path(dir_) / file);
      }
    }
    for (const auto& [pair_id, pair] : pairs) {
      text += PairStatusName(pair.status) + std::to_string(pair.NumInliers());
      for (const PairVerdict& verdict : pair.verdicts) {
        text += PairStageName(verdict.stage);
      }
    }
    for (const auto& [camera_id, camera] : result.cameras) {
      for (const double stddev : camera.stddevs) text += std::to_string(stddev);
    }
    for (const auto& [image_id, scale] : result.depth_scales) {
      text += std::to_string(scale);
    }
    for (const StageReport& stage : result.stages) text += stage.stage;
    return text + std::to_string(result.repeatability->rms_center_error);
  }

  std::string dir_;
  Scene scene_;
  KeypointDepthMap depths_;
  PairVerificationOptions verification_;
  PairGeometries pairs_;
};

TEST_F(ComponentCheckpointsTest, ARunThatWasBrokenOffGivesTheSame) {
  const std::string expected = Map(nullptr);
  for (int num_kept = 1; num_kept <= 3; ++num_kept) {
    CountingStore broken(dir_, num_kept, num_kept);
    EXPECT_THROW(Map(&broken), std::runtime_error);
    CountingStore store(dir_, num_kept);
    EXPECT_EQ(Map(&store), expected);
    EXPECT_EQ(store.num_found, num_kept);
    EXPECT_EQ(store.num_kept, 3 - num_kept);
  }
}

TEST_F(ComponentCheckpointsTest, OnlyThoseOfTheSameKeyAreUsed) {
  CountingStore first(dir_, /*key=*/1);
  Map(&first);
  EXPECT_EQ(first.num_kept, 3);
  CountingStore other(dir_, /*key=*/2);
  Map(&other);
  EXPECT_EQ(other.num_found, 0);
  // Those of the first key are gone for good.
  CountingStore again(dir_, /*key=*/1);
  Map(&again);
  EXPECT_EQ(again.num_found, 0);
}

TEST_F(ComponentCheckpointsTest, DamagedOnesAreMappedAgain) {
  CountingStore first(dir_, /*key=*/1);
  const std::string expected = Map(&first);
  int num_damaged = 0;
  for (const auto& entry : fs::recursive_directory_iterator(dir_)) {
    const std::string name = entry.path().filename();
    const bool is_damaged =
        entry.path().string().find(".dgsfm_checkpoints") != std::string::npos &&
        (name == "component.cbor" ? num_damaged == 0 : name == "images.bin");
    if (!is_damaged || num_damaged == 2) continue;
    fs::resize_file(entry.path(), fs::file_size(entry.path()) / 2);
    ++num_damaged;
  }
  ASSERT_EQ(num_damaged, 2);
  CountingStore store(dir_, /*key=*/1);
  EXPECT_EQ(Map(&store), expected);
  EXPECT_LE(store.num_found, 2);
}

TEST_F(ComponentCheckpointsTest, AreRemoved) {
  ComponentCheckpoints checkpoints(dir_, /*key=*/1);
  Map(&checkpoints);
  const fs::path folder = fs::path(dir_) / ".dgsfm_checkpoints";
  EXPECT_TRUE(fs::exists(folder));
  checkpoints.Remove();
  EXPECT_FALSE(fs::exists(folder));
}

}  // namespace
}  // namespace dgsfm
