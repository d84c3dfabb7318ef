#include "controllers/report/report_page.h"

#include "controllers/commands/commands.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/ring_model.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using Json = nlohmann::ordered_json;
using testing::HasSubstr;
using testing::Not;

constexpr char kReport[] = R"({
  "stages": [{"stage": "load_scene", "seconds": 1}],
  "warnings": ["Mind the </script> gap."],
  "images": [{"name": "ring/0.jpg", "registered": true, "depth_scale": 2.0},
             {"name": "lost.jpg", "registered": false, "reason": "no key points"}],
  "view_graph": [
    {"image1": "ring/0.jpg", "image2": "ring/1.jpg", "status": "valid",
     "num_matches": 258, "num_inliers": 3},
    {"image1": "lost.jpg", "image2": "ring/1.jpg", "status": "no_geometry",
     "num_matches": 1, "num_inliers": 0}]})";

class ReportPageTest : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    std::filesystem::create_directory(dir_ + "/0");
    CreateRingModel(3).WriteText(dir_ + "/0");
    Write("report.json", kReport);
    Write("project.ini",
          "database_path=a = b.db\nnum_threads=-1\n"
          "[DepthGlobalMapper]\nmin_model_size=7\n");
    input_.title = "scene";
    input_.model_folders = {dir_ + "/0"};
    input_.report_path = dir_ + "/report.json";
    input_.project_path = dir_ + "/project.ini";
  }

  void Write(const std::string& name, const std::string& text) const {
    std::ofstream(dir_ + "/" + name, std::ios::binary) << text;
  }

  // The data that the page has.
  static Json DataOf(const std::string& page) {
    const std::string start =
        R"(<script type="application/json" id="report-data">)";
    const size_t begin = page.find(start) + start.size();
    return Json::parse(
        page.substr(begin, page.find("</script>", begin) - begin));
  }

  std::string dir_;
  ReportPageInput input_;
};

TEST_F(ReportPageTest, JoinsModelAndReport) {
  const Json data = ReportPageData(input_);
  ASSERT_EQ(data["images"].size(), 4);
  const Json& lost = data["images"][0];
  EXPECT_EQ(lost["name"], "lost.jpg");
  EXPECT_EQ(lost["reason"], "no key points");
  EXPECT_FALSE(lost.contains("model"));
  const Json& first = data["images"][1];
  EXPECT_EQ(first["name"], "ring/0.jpg");
  EXPECT_EQ(first["model"], 0);
  EXPECT_EQ(first["depth_scale"], 2.0);
  EXPECT_EQ(first["num_points"], 2);
  EXPECT_EQ(data["models"][0]["num_points"], 3);
  EXPECT_EQ(data["models"][0]["points"]["count"], 3);
  // Point i is seen by images i and i + 1, which are 1, 2 and 3 of the page.
  EXPECT_EQ(data["models"][0]["points"]["view_image_bytes"], 2);
  EXPECT_EQ(data["models"][0]["points"]["view_images"], "AQACAAIAAwABAAMA");
  EXPECT_EQ(data["models"][0]["cameras"]["1"]["params"][0], 500);
  EXPECT_EQ(data["report"]["stages"][0]["stage"], "load_scene");
  EXPECT_FALSE(data["report"].contains("view_graph"));
  const Json& pairs = data["pairs"];
  EXPECT_EQ(pairs["count"], 2);
  EXPECT_EQ(pairs["status_names"], Json({"valid", "no_geometry"}));
  // 1, 2, 0, 2 and 258, 1 as 32-bit numbers.
  EXPECT_EQ(pairs["images"], "AQAAAAIAAAAAAAAAAgAAAA==");
  EXPECT_EQ(pairs["statuses"], "AAE=");
  EXPECT_EQ(pairs["num_matches"], "AgEAAAEAAAA=");
}

TEST_F(ReportPageTest, HasOptionsWithTheirDefaults) {
  const Json options = ReportPageData(input_)["options"];
  ASSERT_EQ(options.size(), 3);
  EXPECT_EQ(
      options[0],
      Json(
          {{"name", "database_path"}, {"value", "a = b.db"}, {"default", ""}}));
  EXPECT_EQ(options[1]["default"], "-1");
  EXPECT_EQ(options[2]["name"], "DepthGlobalMapper.min_model_size");
  EXPECT_EQ(options[2]["value"], "7");
  EXPECT_EQ(options[2]["default"], "3");
}

TEST_F(ReportPageTest, CopesWithoutReportAndWithoutModel) {
  ReportPageInput input = input_;
  input.report_path = input.project_path = "";
  EXPECT_EQ(ReportPageData(input)["images"].size(), 3);
  EXPECT_TRUE(ReportPageData(input)["report"].is_null());
  input = input_;
  input.model_folders.clear();
  EXPECT_EQ(ReportPageData(input)["images"].size(), 3);
}

TEST_F(ReportPageTest, RefusesWhatIsNoReport) {
  for (const std::string text :
       {"",
        "[]",
        "{",
        R"({"images": [{}], "view_graph": []})",
        R"({"images": [], "view_graph": [{"image1": 3}]})"}) {
    Write("report.json", text);
    ExpectError([&] { ReportPageData(input_); },
                dir_ + "/report.json is no report of depth_global_mapper");
  }
  input_.report_path = dir_ + "/none.json";
  ExpectError([&] { ReportPageData(input_); }, dir_ + "/none.json");
}

// Names are data: none may become a part of the page.
TEST_F(ReportPageTest, EscapesNames) {
  const std::string name =
      "</script><script>alert(1)</script><!--\"'&\xe9@REPORT_DATA@.jpg";
  colmap::Reconstruction model = CreateRingModel(3);
  model.Image(1).SetName(name);
  model.WriteBinary(dir_ + "/0");
  input_.title = "<b>";
  const std::string path = dir_ + "/page.html";
  WriteReportPage(input_, path);
  const std::string page = FileContent(path);
  EXPECT_THAT(page, Not(HasSubstr("alert(1)</script>")));
  EXPECT_THAT(page, Not(HasSubstr("<b>")));
  const Json data = DataOf(page);
  EXPECT_EQ(data["title"], "<b>");
  EXPECT_EQ(
      data["images"][0]["name"],
      "</script><script>alert(1)</script><!--\"'&\uFFFD@REPORT_DATA@.jpg");
  EXPECT_EQ(data["report"]["warnings"][0], "Mind the </script> gap.");
}

TEST_F(ReportPageTest, IsTheSameEachTimeAndHasTheLicence) {
  WriteReportPage(input_, dir_ + "/1.html");
  input_.num_threads = 1;
  WriteReportPage(input_, dir_ + "/2.html");
  const std::string page = FileContent(dir_ + "/1.html");
  EXPECT_EQ(FileContent(dir_ + "/2.html"), page);
  EXPECT_THAT(page, HasSubstr("three.js authors"));
  EXPECT_THAT(page, HasSubstr("default-src 'none'"));
}

TEST_F(ReportPageTest, CommandWritesThePageOrSaysWhyNot) {
  const std::string page = dir_ + "/report.html";
  const auto run = [&](const std::string& input_path,
                       const std::string& output_path) {
    return RunForTest(
        &RunModelReporter,
        {"--input_path", input_path, "--output_path", output_path});
  };
  EXPECT_EQ(run(dir_ + "/", page).code, 0);
  EXPECT_EQ(DataOf(FileContent(page))["title"],
            std::filesystem::path(dir_).filename().string());
  EXPECT_EQ(run(dir_ + "/0", page).code, 0);
  EXPECT_TRUE(DataOf(FileContent(page))["report"].is_null());

  const CommandResult missing = run(dir_ + "/1", page);
  EXPECT_EQ(missing.code, 1);
  EXPECT_THAT(missing.err, HasSubstr(dir_ + "/1 does not exist"));
  const CommandResult unwritable = run(dir_, dir_ + "/none/a.html");
  EXPECT_EQ(unwritable.code, 1);
  EXPECT_THAT(unwritable.err, HasSubstr(dir_ + "/none/a.html"));
  std::filesystem::remove_all(dir_ + "/0");
  EXPECT_EQ(run(dir_, page).code, 0);
  std::filesystem::remove(dir_ + "/report.json");
  EXPECT_EQ(run(dir_, page).code, 1);
}

}  // namespace
}  // namespace dgsfm
