#include "controllers/commands/command_options.h"

#include "tests/testing/expect_error.h"
#include "tests/testing/test_dir.h"

#include <cmath>
#include <fstream>
#include <limits>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::HasSubstr;

struct Values {
  std::string path = "a";
  bool flag = true;
  int count = 3;
  double threshold_px = 0.1;
  bool group_flag = false;
  int group_count = -1;
  double group_angle_deg = 1e-300;
  std::string group_name = "";
};

class CommandOptionsTest : public testing::Test {
 protected:
  // Parses into values_ and captures what is printed.
  std::optional<int> Parse(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "colmap");
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    const std::unique_ptr<CommandOptions> options = Bind();
    testing::internal::CaptureStdout();
    testing::internal::CaptureStderr();
    std::optional<int> code;
    try {
      code = options->Parse(argv.size(), argv.data());
    } catch (...) {
      testing::internal::GetCapturedStdout();
      testing::internal::GetCapturedStderr();
      throw;
    }
    stdout_ = testing::internal::GetCapturedStdout();
    stderr_ = testing::internal::GetCapturedStderr();
    return code;
  }

  std::unique_ptr<CommandOptions> Bind() {
    auto options =
        std::make_unique<CommandOptions>("some_command", "Does something.");
    if (is_path_required_) {
      options->AddRequired("path", &values_.path, "Where it is.");
    } else {
      options->Add("path", &values_.path, "Where it is.");
    }
    options->Add("Group.flag", &values_.group_flag, "Of a group.");
    options->Add("flag", &values_.flag, "A switch.");
    options->Add("count", &values_.count, "A number.");
    options->Add("threshold", &values_.threshold_px, "A limit [px].");
    options->Add("Group.count", &values_.group_count, "Of a group.");
    options->Add("Group.angle", &values_.group_angle_deg, "An angle [deg].");
    options->Add("Group.name", &values_.group_name, "Of a group.");
    return options;
  }

  std::string WriteFile(const std::string& text) {
    const std::string path = CreateTestDir() + "/project.ini";
    std::ofstream(path) << text;
    return path;
  }

  Values values_;
  bool is_path_required_ = false;
  std::string stdout_;
  std::string stderr_;
};

TEST_F(CommandOptionsTest, NoArgumentsKeepDefaults) {
  EXPECT_EQ(Parse({}), std::nullopt);
  EXPECT_EQ(values_.path, "a");
  EXPECT_TRUE(values_.flag);
  EXPECT_EQ(values_.count, 3);
  EXPECT_EQ(values_.threshold_px, 0.1);
}

TEST_F(CommandOptionsTest, CommandLineSetsEveryType) {
  EXPECT_EQ(Parse({"--path",
                   "b c",
                   "--flag",
                   "0",
                   "--count=-7",
                   "--threshold",
                   "-2.5e3",
                   "--Group.flag",
                   "1",
                   "--Group.count",
                   "-4"}),
            std::nullopt);
  EXPECT_EQ(values_.path, "b c");
  EXPECT_FALSE(values_.flag);
  EXPECT_EQ(values_.count, -7);
  EXPECT_EQ(values_.threshold_px, -2500);
  EXPECT_TRUE(values_.group_flag);
  EXPECT_EQ(values_.group_count, -4);
}

TEST_F(CommandOptionsTest, HelpShowsSummaryDefaultsAndText) {
  is_path_required_ = true;
  EXPECT_EQ(Parse({"--help"}), 0);
  EXPECT_EQ(stderr_, "");
  for (const char* text : {"some_command: Does something.",
                           "--path",
                           "Where it is. (required)",
                           "--threshold arg (=0.1)",
                           "A limit [px].",
                           "--flag arg (=1)",
                           "--Group.angle arg (=1e-300)",
                           "--project_path"}) {
    EXPECT_THAT(stdout_, HasSubstr(text));
  }
  EXPECT_EQ(Parse({"-h"}), 0);
}

TEST_F(CommandOptionsTest, WrongUsageReturnsTwoAndNamesTheOption) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--pathology", "b"}, "pathology"},
      {{"--pat", "b"}, "pat"},
      {{"--count", "three"}, "count"},
      {{"--count", "1.5"}, "count"},
      {{"--count", "99999999999"}, "count"},
      {{"--flag", "2"}, "flag"},
      {{"--threshold", "nan"}, "threshold"},
      {{"--threshold"}, "threshold"},
      {{"--count", "1", "--count", "2"}, "count"},
      {{"stray"}, "stray"}};
  for (const auto& [arguments, name] : cases) {
    EXPECT_EQ(Parse(arguments), 2) << arguments.front();
    EXPECT_THAT(stderr_, HasSubstr(name));
    EXPECT_EQ(stdout_, "");
  }
  EXPECT_EQ(values_.count, 3);
}

TEST_F(CommandOptionsTest, MissingRequiredReturnsTwo) {
  is_path_required_ = true;
  EXPECT_EQ(Parse({"--count", "1"}), 2);
  EXPECT_THAT(stderr_, HasSubstr("path"));
  EXPECT_EQ(Parse({"--path", "b"}), std::nullopt);
  EXPECT_EQ(values_.path, "b");
}

TEST_F(CommandOptionsTest, ReadsProjectFileAndCommandLineWins) {
  is_path_required_ = true;
  const std::string project = WriteFile(
      "# comment\ncount=5\npath = from/file with # and ; \nflag=false\n"
      "[Group]\ncount=6\nname=\n");
  EXPECT_EQ(Parse({"--project_path", project, "--Group.count", "8"}),
            std::nullopt);
  EXPECT_EQ(values_.path, "from/file with # and ;");
  EXPECT_EQ(values_.count, 5);
  EXPECT_FALSE(values_.flag);
  EXPECT_EQ(values_.group_count, 8);
  EXPECT_EQ(values_.group_name, "");
}

TEST_F(CommandOptionsTest, WrongProjectFileIsReported) {
  EXPECT_EQ(Parse({"--project_path", WriteFile("[Group]\nwidth=5\n")}), 2);
  EXPECT_THAT(stderr_, HasSubstr("Group.width"));
  EXPECT_EQ(Parse({"--project_path", WriteFile("count=x\n")}), 2);
  EXPECT_THAT(stderr_, HasSubstr("count"));
  EXPECT_THROW(Parse({"--project_path", WriteFile("no assignment\n")}),
               std::runtime_error);
  EXPECT_THROW(Parse({"--project_path", "/does/not/exist.ini"}),
               std::runtime_error);
}

TEST_F(CommandOptionsTest, WrittenProjectReadsBackExactly) {
  Values written;
  written.path = "  spaces, \"quotes\", # = ; and \xc3\xa4  ";
  written.flag = false;
  written.count = std::numeric_limits<int>::min();
  written.threshold_px = std::nextafter(0.1, 1.0);
  written.group_flag = true;
  written.group_count = std::numeric_limits<int>::max();
  written.group_angle_deg = std::numeric_limits<double>::denorm_min();
  written.group_name = "\"quoted\"";
  values_ = written;
  const std::string project = CreateTestDir() + "/project.ini";
  Bind()->WriteProject(project);
  values_ = Values();
  EXPECT_EQ(Parse({"--project_path", project}), std::nullopt);
  EXPECT_EQ(values_.path, written.path);
  EXPECT_EQ(values_.flag, written.flag);
  EXPECT_EQ(values_.count, written.count);
  EXPECT_EQ(values_.threshold_px, written.threshold_px);
  EXPECT_EQ(values_.group_flag, written.group_flag);
  EXPECT_EQ(values_.group_count, written.group_count);
  EXPECT_EQ(values_.group_angle_deg, written.group_angle_deg);
  EXPECT_EQ(values_.group_name, written.group_name);
}

TEST_F(CommandOptionsTest, UnwritableProjectThrows) {
  EXPECT_THROW(Bind()->WriteProject("/does/not/exist/project.ini"),
               std::runtime_error);
  values_.path = "two\nlines";
  EXPECT_THROW(Bind()->WriteProject(CreateTestDir() + "/project.ini"),
               std::runtime_error);
}

TEST_F(CommandOptionsTest, OptionsAreListedAndSetByName) {
  is_path_required_ = true;
  const std::unique_ptr<CommandOptions> options = Bind();
  const CommandOptions::Option& path = options->Options().front();
  EXPECT_EQ(path.name, "path");
  EXPECT_EQ(path.help, "Where it is.");
  EXPECT_TRUE(path.is_required);
  path.set(std::string("b"));
  EXPECT_EQ(values_.path, "b");
  for (const CommandOptions::Option& option : options->Options()) {
    if (option.name != "threshold") continue;
    EXPECT_EQ(std::get<double>(option.get()), 0.1);
    option.set(2.0);
    EXPECT_EQ(values_.threshold_px, 2);
    ExpectError([&] { option.set(1); }, "threshold must be a number");
    ExpectError([&] { option.set(std::nan("")); }, "threshold");
  }
}

TEST_F(CommandOptionsTest, ChoicesAreParsedListedAndWritten) {
  int value = 7;
  CommandOptions options("some_command", "Does something.");
  options.AddChoice<int>("kind", &value, {{"low", 3}, {"high", 7}}, "Which.");
  EXPECT_EQ(options.ProjectText(), "kind=high\n");
  EXPECT_EQ(options.Options()[0].choices,
            (std::vector<std::string>{"low", "high"}));
  std::vector<std::string> texts = {"colmap", "--kind", "low"};
  std::vector<char*> argv;
  for (std::string& text : texts) argv.push_back(text.data());
  EXPECT_EQ(options.Parse(3, argv.data()), std::nullopt);
  EXPECT_EQ(value, 3);
  texts[2] = "middle";
  argv[2] = texts[2].data();
  testing::internal::CaptureStderr();
  EXPECT_EQ(options.Parse(3, argv.data()), 2);
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              HasSubstr("kind is 'middle' but must be one of low, high"));
  ExpectError([&] { options.Options()[0].set(std::string("middle")); },
              "must be one of low, high");
}

}  // namespace
}  // namespace dgsfm
