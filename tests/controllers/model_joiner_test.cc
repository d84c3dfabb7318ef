#include "colmap_ext/model/model_writer.h"
#include "colmap_ext/pose_access.h"
#include "controllers/image_list.h"
#include "controllers/model_evaluator.h"
#include "controllers/part_model_reader.h"
#include "controllers/view_graph_partitioner.h"
#include "tests/controllers/pair_rows.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/test_dir.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// A street of forty images, whose pairs are verified.
class ModelJoiner : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    path_ = SynthesizeDatabase(dir_,
                               {"--family",
                                "street",
                                "--num_images",
                                "40",
                                "--num_cameras",
                                "1",
                                "--num_points_per_image",
                                "200",
                                "--max_num_neighbors",
                                "12"});
    ExpectSuccess(
        RunForTest(&RunDepthGeometricVerifier, {"--database_path", path_}));
  }

  static void ExpectSuccess(const CommandResult& result) {
    EXPECT_EQ(result.code, 0) << result.err;
  }

  CommandResult Map(const std::string& output_path,
                    std::vector<std::string> options = {}) const {
    const std::vector<std::string> required = {
        "--database_path", path_, "--output_path", output_path};
    options.insert(options.begin(), required.begin(), required.end());
    return RunForTest(&RunDepthGlobalMapper, options);
  }

  void Partition(const std::string& folder,
                 const std::string& max_part_size,
                 const std::string& overlap) const {
    ExpectSuccess(RunForTest(&RunViewGraphPartitioner,
                             {"--database_path",
                              path_,
                              "--output_path",
                              folder,
                              "--max_part_size",
                              max_part_size,
                              "--overlap",
                              overlap}));
  }

  // Maps the parts into folders beside the lists; returns these.
  std::string MapParts(const std::string& folder) const {
    std::string paths;
    for (int i = 0;; ++i) {
      const std::string part = folder + "/part_000" + std::to_string(i);
      if (!fs::exists(part + ".txt")) return paths;
      ExpectSuccess(Map(part, {"--image_list_path", part + ".txt"}));
      paths += (paths.empty() ? "" : ",") + part;
    }
  }

  CommandResult Join(const std::string& paths,
                     const std::string& output_path) const {
    return RunForTest(&RunModelJoiner,
                      {"--database_path",
                       path_,
                       "--input_paths",
                       paths,
                       "--output_path",
                       output_path});
  }

  ModelEvaluation Evaluate(const std::string& model_path) const {
    return EvaluateModel(model_path, dir_ + "/scene/gt", {1, 5});
  }

  std::string dir_;
  std::string path_;
};

TEST_F(ModelJoiner, PartsGiveTheModelOfOneRun) {
  ExpectSuccess(Map(dir_ + "/single"));
  const std::string parts = dir_ + "/parts";
  Partition(parts, "22", "0.3");
  const std::vector<std::string> rows = PairRows(path_);
  const std::string paths = MapParts(parts);
  // A part leaves the pairs of others alone.
  EXPECT_EQ(PairRows(path_), rows);
  ExpectSuccess(Join(paths, dir_ + "/joined"));
  const ModelEvaluation single = Evaluate(dir_ + "/single");
  const ModelEvaluation joined = Evaluate(dir_ + "/joined");
  EXPECT_EQ(joined.num_models, 1);
  EXPECT_EQ(joined.metrics.num_registered, 40);
  // Both are at the minimum of one adjustment, up to its tolerance.
  EXPECT_GT(joined.auc[0], single.auc[0] - 1);
  EXPECT_GT(joined.auc[1], single.auc[1] - 0.5);
}

// False pairs fold a part: half of its images are where others are.
TEST_F(ModelJoiner, ReportsAPartThatContradictsTheOthers) {
  const std::string parts = dir_ + "/parts";
  Partition(parts, "18", "0.4");
  const std::string paths = MapParts(parts);
  const std::string folded = parts + "/part_0001/0";
  colmap::Reconstruction model;
  model.Read(folded);
  std::vector<colmap::image_t> image_ids = model.RegImageIds();
  std::sort(image_ids.begin(), image_ids.end());
  for (size_t i = 0; 2 * i < image_ids.size(); ++i) {
    colmap::Image& first = model.Image(image_ids[i]);
    colmap::Image& last = model.Image(image_ids[image_ids.size() - 1 - i]);
    const Rigid3d pose = CamFromWorld(first);
    SetCamFromWorld(CamFromWorld(last), &first);
    SetCamFromWorld(pose, &last);
  }
  WriteModel(model, folded);
  ExpectSuccess(Join(paths, dir_ + "/joined"));
  EXPECT_TRUE(fs::exists(dir_ + "/joined/1/images.bin"));
  std::ifstream file(dir_ + "/joined/report.json");
  const nlohmann::json report = nlohmann::json::parse(file);
  for (const auto& entry : report["models"]) {
    // The folded part is a model of its own.
    const bool has_it =
        std::count(entry["parts"].begin(), entry["parts"].end(), folded) > 0;
    EXPECT_TRUE(!has_it || entry["parts"].size() == 1);
  }
  ASSERT_FALSE(report["warnings"].empty());
  for (const std::string warning : report["warnings"]) {
    EXPECT_THAT(warning, HasSubstr(folded));
    EXPECT_THAT(warning, HasSubstr("contradict each other"));
  }
  EXPECT_EQ(report["images"].size(), 40);
  ExpectSuccess(RunForTest(&RunModelReporter,
                           {"--input_path",
                            dir_ + "/joined",
                            "--output_path",
                            dir_ + "/joined.html"}));
}

TEST_F(ModelJoiner, PartitionCoversAllImages) {
  GraphPartitionOptions options;
  options.max_part_size = 15;
  const ViewGraphPartition partition = PartitionViewGraph(path_, options);
  std::set<std::string> names;
  for (const auto& part : partition.parts) {
    EXPECT_LE(part.size(), 15);
    names.insert(part.begin(), part.end());
  }
  EXPECT_EQ(names.size(), 40);
  SqliteConnection(path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("DELETE FROM dgsfm_pair_geometries");
  ExpectError([&] { PartitionViewGraph(path_, options); },
              "has no verified pairs that are valid");
}

TEST_F(ModelJoiner, NamesWhatLacksInListsAndModels) {
  std::ofstream(dir_ + "/list.txt") << "no_such.jpg\n";
  const CommandResult result =
      Map(dir_ + "/part", {"--image_list_path", dir_ + "/list.txt"});
  EXPECT_EQ(result.code, 1);
  EXPECT_THAT(result.err, HasSubstr("has no image no_such.jpg"));
  std::ofstream(dir_ + "/empty.txt") << "\n\r\n";
  ExpectError([&] { ReadImageList(dir_ + "/empty.txt"); }, "is empty");
  ExpectError([&] { ReadImageList(dir_ + "/no.txt"); }, "cannot read");
  EXPECT_EQ(Join(dir_ + "/no_models", dir_ + "/joined").code, 1);
  // Images were deleted since.
  ExpectSuccess(Map(dir_ + "/single"));
  Scene scene = ReadScene(path_);
  ASSERT_EQ(ReadPartModels(dir_ + "/single", scene).size(), 1);
  scene.images.erase(scene.images.begin());
  ExpectError([&] { ReadPartModels(dir_ + "/single", scene); },
              "which the database lacks");
}

}  // namespace
}  // namespace dgsfm
