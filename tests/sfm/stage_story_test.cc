#include "sfm/stage_story.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;

using Figures = std::vector<std::pair<std::string, double>>;

StageReport Report(const std::string& stage,
                   double seconds,
                   const Figures& figures = {}) {
  StageReport report;
  report.stage = stage;
  report.seconds = seconds;
  report.figures = figures;
  return report;
}

std::vector<StageReport> ReportsOfOneModel() {
  return {
      Report("rotation_averaging",
             0.25,
             {{"images", 19}, {"pairs_filtered", 23}, {"images_kept", 18}}),
      Report("rotation_recovery",
             0,
             {{"pairs_verified", 40}, {"pairs_recovered", 2}}),
      Report("scale_averaging", 0.5, {{"pairs", 67}, {"images", 18}}),
      Report("translation_averaging", 0.5, {{"pairs_filtered", 1}}),
      Report("initialization",
             1,
             {{"tracks", 9966}, {"images", 17}, {"points", 9966}}),
      Report(
          "global_positioning",
          125,
          {{"converged", 1}, {"observations_filtered", 0}, {"points", 9960}}),
      Report("bundle_adjustment",
             10,
             {{"rms_px", 0.4}, {"observations_filtered", 100}, {"points", 9}}),
      Report("bundle_adjustment",
             10,
             {{"rms_px", 0.3}, {"observations_filtered", 12}, {"points", 8}}),
      Report("self_calibration",
             0.01,
             {{"groups", 1}, {"cameras", 19}, {"principal_points_held", 0}}),
      Report("retriangulation",
             1,
             {{"observations_gained", 3393},
              {"rms_px", 0.34},
              {"observations_filtered", 194},
              {"points", 1234567}}),
      Report("metric_scale",
             0,
             {{"images", 17},
              {"points", 1234567},
              {"log_scale_spread", 0.1},
              {"images_with_scale", 17}}),
  };
}

std::vector<std::string> Story(const std::vector<StageReport>& reports) {
  std::vector<std::string> sentences;
  for (size_t i = 1; i <= reports.size(); ++i) {
    for (const std::string& sentence :
         NextSentences({reports.begin(), reports.begin() + i})) {
      sentences.push_back(sentence);
    }
  }
  return sentences;
}

TEST(StageStory, DescribesThePreparation) {
  EXPECT_THAT(
      Story({Report("load_scene",
                    0.06,
                    {{"cameras", 1},
                     {"cameras_calibrated", 1},
                     {"cameras_with_exif", 0},
                     {"images", 1000},
                     {"pairs", 15000}}),
             Report("load_depth", 0, {{"images", 0}}),
             Report("pair_verification",
                    75.4,
                    {{"kept", 3},
                     {"valid", 90},
                     {"no_geometry", 2},
                     {"too_few_inliers", 1},
                     {"valid_planar", 3}}),
             Report("depth_reliability", 1, {{"maps_dropped", 1}}),
             Report("view_graph_filter",
                    0,
                    {{"valid", 88},
                     {"filtered_low_pair_score", 2},
                     {"filtered_low_triplet_support", 0}}),
             Report("focal_averaging", 0, {{"pairs", 2}, {"view_graph", 1}}),
             Report("reverification", 1, {{"pairs_verified", 4}})}),
      ElementsAre("Database: 1,000 images, 15,000 matched pairs, 1 camera (1 "
                  "calibrated, 0 with a focal length of EXIF data) (0.1 s)",
                  "Depth: none",
                  "Pairs: 90 of 93 valid; 2 no geometry, 1 too few inliers; 3 "
                  "pairs verified before (75 s)",
                  "Focal lengths: 2 cameras by pairs, 1 camera by view graph; "
                  "4 pairs verified with these; 1 depth map left out; 2 pairs "
                  "left out (low pair score) (2.0 s)"));
}

TEST(StageStory, NamesWhyStoredResultsLeave) {
  EXPECT_THAT(
      Story({Report("pair_verification", 0, {{"deleted", 2}, {"valid", 90}})}),
      ElementsAre("Pairs: 90 of 90 valid; 2 stored results deleted, as "
                  "matches, depths or options changed"));
  EXPECT_THAT(
      Story(
          {Report("pair_verification", 0, {{"restarted", 2}, {"valid", 90}})}),
      ElementsAre("Pairs: 90 of 90 valid; 2 stored results deleted, as all "
                  "pairs were to be verified again (restart)"));
}

TEST(StageStory, DescribesAModelWithOneSentenceForRepeatedStages) {
  EXPECT_THAT(
      Story(ReportsOfOneModel()),
      ElementsAre("Rotations: 18 of 19 images; 23 pairs left out; 2 pairs "
                  "found again (0.2 s)",
                  "First positions: 17 images, 9,966 tracks; 1 pair left out "
                  "(2.0 s)",
                  "Global positioning: 9,960 points (2 min 5 s)",
                  "Bundle adjustment: 2 rounds, 8 points, error 0.30 px rms; "
                  "112 observations left out (20 s)",
                  "Self-calibration: 19 cameras tied in 1 group",
                  "Completion: 3,393 observations gained, 194 observations "
                  "left out, 1,234,567 points, error 0.34 px rms (1.0 s)",
                  "Scale: that of 17 depth maps, which differ by 11 %"));
}

TEST(StageStory, NamesRigsThatFixTheScale) {
  EXPECT_THAT(Story({Report("metric_scale",
                            0,
                            {{"images", 17},
                             {"points", 50},
                             {"images_with_scale", 0},
                             {"scale_by_rigs", 1}})}),
              ElementsAre("Scale: that of the rigs' baselines"));
}

TEST(StageStory, GivesFurtherModelsOneSentenceEach) {
  std::vector<StageReport> reports = ReportsOfOneModel();
  const size_t num_sentences = Story(reports).size();
  for (int i = 0; i < 2; ++i) {
    const std::vector<StageReport> more = ReportsOfOneModel();
    reports.insert(reports.end(), more.begin(), more.end());
  }
  reports.push_back(Report("write_models", 0, {{"models", 3}}));
  const std::vector<std::string> sentences = Story(reports);
  ASSERT_EQ(sentences.size(), num_sentences + 3);
  EXPECT_EQ(sentences[num_sentences],
            "Model 2: 17 images, 1,234,567 points (2 min 28 s)");
  EXPECT_EQ(sentences[num_sentences + 2], "Wrote 3 models");
}

TEST(StageStory, EndsAPartThatTheNextOneEnds) {
  EXPECT_THAT(Story({Report("final_adjustment", 0, {{"rms_px", 1}}),
                     Report("unknown_stage", 1)}),
              ElementsAre("Completion: 0 observations gained, 0 observations "
                          "left out, 0 points, error 1.00 px rms"));
}

}  // namespace
}  // namespace dgsfm
