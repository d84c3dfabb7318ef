#include "controllers/mapper_summary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;
using testing::Not;

// Images a.jpg, b.jpg, ... of ids 1, 2, ...
Scene SceneOf(int num_images) {
  Scene scene;
  for (int i = 0; i < num_images; ++i) {
    colmap::Image image;
    image.SetImageId(i + 1);
    image.SetName(std::string(1, 'a' + i) + ".jpg");
    scene.images[i + 1] = image;
  }
  return scene;
}

DepthGlobalMapperResult ResultWith(const MeasuredUnit& unit,
                                   const std::vector<double>& errors_px) {
  DepthGlobalMapperResult result;
  result.models.push_back(std::make_unique<colmap::Reconstruction>());
  for (const double error : errors_px) {
    const auto id =
        result.models[0]->AddPoint3D(Eigen::Vector3d::Zero(), colmap::Track());
    result.models[0]->Point3D(id).SetError(error);
  }
  result.units.push_back(unit);
  return result;
}

TEST(MapperSummary, GivesTheModelItsErrorAndUncertainUnit) {
  MeasuredUnit unit;
  unit.unit = ModelUnit::METRES;
  unit.num_images = 25;
  unit.log_spread = 0.1;
  const std::string text =
      MapperSummary(SceneOf(0), ResultWith(unit, {0.2, 9, 0.3}), "out");
  EXPECT_THAT(text,
              HasSubstr("3 points, median error 0.30 px, unit metres, "
                        "uncertain by 3 %: 25 depth maps, which differ by 11 "
                        "%"));
  EXPECT_THAT(text, HasSubstr("check: nothing looks odd\n"));
  EXPECT_THAT(text, HasSubstr("report: out/report.json\n"));
}

TEST(MapperSummary, GroupsMissingImagesByReasonAndNamesTheRemedy) {
  DepthGlobalMapperResult result = ResultWith({}, {3});
  result.unregistered_images = {{1, "no key points"},
                                {2, "no matches with other images"},
                                {3, "no matches with other images"},
                                {4, "no matches with other images"},
                                {5, "no matches with other images"}};
  result.warnings = {"A warning"};
  const std::string text = MapperSummary(SceneOf(5), result, "out");
  EXPECT_THAT(text, HasSubstr("check: A warning\n"));
  EXPECT_THAT(text,
              HasSubstr("check: not registered: b.jpg, c.jpg, d.jpg and 1 "
                        "more: no matches with other images; match it with "
                        "more images\ncheck: not registered: a.jpg: no key "
                        "points; "));
  EXPECT_THAT(text, HasSubstr("the median error is large"));
  EXPECT_THAT(text, HasSubstr("no depth map gives the unit"));
  EXPECT_THAT(text, Not(HasSubstr("nothing looks odd")));
}

TEST(MapperSummary, StaysShortWithManyModelsAndReasons) {
  DepthGlobalMapperResult result;
  for (int i = 0; i < 12; ++i) {
    result.models.push_back(std::make_unique<colmap::Reconstruction>());
    result.units.emplace_back();
    result.unregistered_images[i + 1] = "reason " + std::to_string(i);
  }
  const std::string text = MapperSummary(SceneOf(12), result, "out");
  EXPECT_THAT(text, HasSubstr("model 9: "));
  EXPECT_THAT(text, Not(HasSubstr("model 10: ")));
  EXPECT_THAT(text, HasSubstr("2 more models, see report.json\n"));
  EXPECT_THAT(text, HasSubstr("more images are not registered"));
}

}  // namespace
}  // namespace dgsfm
