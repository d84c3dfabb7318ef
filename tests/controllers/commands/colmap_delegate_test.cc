// Runs the built executable with scripts in place of COLMAP.

#include "controllers/commands/colmap_delegate.h"

#include "controllers/commands/commands.h"
#include "tests/testing/ring_model.h"
#include "tests/testing/test_dir.h"

#include <csignal>
#include <filesystem>
#include <fstream>
#include <future>

#include <boost/asio/io_context.hpp>
#include <boost/process.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

namespace dgsfm {
namespace {

namespace bp = boost::process;
namespace fs = std::filesystem;

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

constexpr char kHelp38[] =
    "COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo\n"
    "              (Commit Unknown on Unknown without CUDA)\n\n"
    "Usage:\n  colmap [command] [options]\n\n"
    "Example usage:\n  colmap gui\n  ...\n\n"
    "Available commands:\n  help\n  gui\n  mapper\n\n";
constexpr char kHelp42[] =
    "COLMAP 4.2.0.dev0 (Commit 0123abc on 2026-08-08 with CUDA)\n"
    "Usage:\n  colmap [command] [options]\n"
    "Available commands:\n  help\n  version\n  global_mapper\n\n";

TEST(ParseColmapHelp, ReadsBothFormats) {
  const ColmapHelp help38 = ParseColmapHelp(kHelp38);
  EXPECT_EQ(help38.version, "3.8");
  EXPECT_THAT(help38.commands, ElementsAre("gui", "mapper"));
  const ColmapHelp help42 = ParseColmapHelp(kHelp42);
  EXPECT_EQ(help42.version, "4.2.0.dev0");
  EXPECT_THAT(help42.commands, ElementsAre("version", "global_mapper"));
}

TEST(ParseColmapHelp, OtherTextHasNoCommands) {
  for (const char* text : {"", "usage: something\n  else\n", "\xff\xfe\n\n"}) {
    const ColmapHelp help = ParseColmapHelp(text);
    EXPECT_EQ(help.version, "");
    EXPECT_THAT(help.commands, IsEmpty());
  }
}

struct Result {
  int code = -1;  // exit code, -1 if a signal ended the program
  int signal = 0;
  std::string out;
  std::string err;
};

class ColmapExecutable : public testing::Test {
 protected:
  ColmapExecutable() : dir_(CreateTestDir()) {
    environment_["PATH"] = dir_ + "/bin:/bin";
    environment_.erase("DGSFM_COLMAP_EXE");
    // A COLMAP of the machine must not take part.
    environment_["DGSFM_COLMAP_VISITED"] =
        "/usr/local/bin/colmap:/usr/bin/colmap";
    fs::create_directory(dir_ + "/bin");
  }

  std::string WriteScript(const std::string& name, const std::string& text) {
    const std::string path = dir_ + "/" + name;
    std::ofstream(path) << "#!/bin/sh\n" << text;
    fs::permissions(path, fs::perms::owner_all);
    return path;
  }

  // A script that prints `help` as `colmap help`.
  std::string WriteColmap(const std::string& name, const std::string& help) {
    std::ofstream(dir_ + "/help.txt") << help;
    return WriteScript(name, "cat " + dir_ + "/help.txt\n");
  }

  Result Run(const std::vector<std::string>& arguments,
             const std::string& input = "") const {
    std::ofstream(dir_ + "/stdin") << input;
    boost::asio::io_context context;
    std::future<std::string> out, err;
    bp::child child(DGSFM_COLMAP_MAIN,
                    bp::args(arguments),
                    environment_,
                    context,
                    bp::std_in<(dir_ + "/stdin"), bp::std_out> out,
                    bp::std_err > err);
    context.run();
    child.wait();
    const int status = child.native_exit_code();
    Result result;
    if (WIFEXITED(status)) result.code = WEXITSTATUS(status);
    if (WIFSIGNALED(status)) result.signal = WTERMSIG(status);
    result.out = out.get();
    result.err = err.get();
    return result;
  }

  std::string dir_;
  bp::environment environment_ = boost::this_process::environment();
};

TEST_F(ColmapExecutable, HelpListsOursFirstThenThoseOfColmap) {
  const std::string path = WriteColmap("bin/colmap", kHelp38);
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{}, {"help"}, {"-h"}}) {
    const Result result = Run(arguments);
    EXPECT_EQ(result.code, 0);
    EXPECT_EQ(result.err, "");
    for (const Command& command : Commands()) {
      EXPECT_LT(result.out.find("  " + command.name),
                result.out.find("  mapper\n"));
      EXPECT_THAT(result.out, HasSubstr(command.summary));
    }
    EXPECT_THAT(
        result.out,
        HasSubstr("Available commands of COLMAP 3.8 (" + path + "):\n  gui\n"));
  }
}

TEST_F(ColmapExecutable, PassesEverythingOn) {
  WriteScript("bin/colmap",
              "for argument; do echo \"<$argument>\"; done\ncat\n"
              "echo problem >&2\nexit 7\n");
  const Result result = Run({"mapper", "--a b", "", "*"}, "input\n");
  EXPECT_EQ(result.code, 7);
  EXPECT_EQ(result.out, "<mapper>\n<--a b>\n<>\n<*>\ninput\n");
  EXPECT_EQ(result.err, "problem\n");
}

TEST_F(ColmapExecutable, SignalThatEndsColmapEndsUs) {
  WriteScript("bin/colmap", "kill -TERM $$\n");
  EXPECT_EQ(Run({"mapper"}).signal, SIGTERM);
}

TEST_F(ColmapExecutable, VariableWinsOverPath) {
  WriteScript("bin/colmap", "exit 7\n");
  environment_["DGSFM_COLMAP_EXE"] = WriteScript("other", "exit 8\n");
  EXPECT_EQ(Run({"mapper"}).code, 8);
}

TEST_F(ColmapExecutable, WrongVariableIsReported) {
  WriteScript("bin/colmap", "exit 7\n");
  fs::create_symlink(DGSFM_COLMAP_MAIN, dir_ + "/link");
  for (const std::string& named :
       {dir_ + "/none", dir_, std::string("/etc/passwd"), dir_ + "/link"}) {
    environment_["DGSFM_COLMAP_EXE"] = named;
    const Result result = Run({"mapper"});
    EXPECT_EQ(result.code, 1);
    EXPECT_THAT(result.err, HasSubstr("DGSFM_COLMAP_EXE=" + named));
  }
  // Our own commands do not look for COLMAP.
  EXPECT_EQ(Run({"model_evaluator", "--help"}).code, 0);
}

TEST_F(ColmapExecutable, WithoutColmapOursWorkAndOthersSayWhatToInstall) {
  const Result help = Run({"help"});
  EXPECT_EQ(help.code, 0);
  EXPECT_THAT(
      help.out,
      AllOf(HasSubstr("model_evaluator"), HasSubstr("No COLMAP was found")));
  const Result other = Run({"mapper"});
  EXPECT_EQ(other.code, 1);
  EXPECT_THAT(other.err,
              AllOf(HasSubstr("mapper"),
                    HasSubstr("apt install colmap"),
                    HasSubstr("DGSFM_COLMAP_EXE")));
}

TEST_F(ColmapExecutable, LinksAndScriptsThatLeadBackAreSkipped) {
  fs::create_directory(dir_ + "/bin2");
  fs::create_directory(dir_ + "/bin3");
  environment_["PATH"] = dir_ + "/bin:" + dir_ + "/bin2:" + dir_ + "/bin3:/bin";
  fs::create_symlink(DGSFM_COLMAP_MAIN, dir_ + "/bin/colmap");
  WriteScript("bin2/colmap", "exec " DGSFM_COLMAP_MAIN " \"$@\"\n");
  EXPECT_EQ(Run({"mapper"}).code, 1);
  const Result help = Run({"help"});
  EXPECT_EQ(help.code, 0);
  EXPECT_THAT(help.out, HasSubstr("does not list them"));

  WriteColmap("bin3/colmap", kHelp42);
  EXPECT_EQ(Run({"mapper"}).out, kHelp42);
  EXPECT_THAT(Run({"help"}).out,
              HasSubstr("of COLMAP 4.2.0.dev0 (" + dir_ + "/bin2/colmap):\n"));

  environment_["DGSFM_COLMAP_EXE"] = dir_ + "/bin2/colmap";
  const Result named = Run({"mapper"});
  EXPECT_EQ(named.code, 1);
  EXPECT_THAT(named.err, HasSubstr("leads back"));
}

TEST_F(ColmapExecutable, HelpSurvivesColmapThatFailsOrHangs) {
  const std::string failing = WriteScript("bin/colmap", "exit 1\n");
  const Result result = Run({"help"});
  EXPECT_EQ(result.code, 0);
  EXPECT_THAT(result.out, HasSubstr("passed on to " + failing));

  const std::string hanging = WriteScript("hang", "sleep 600\n");
  const auto start = std::chrono::steady_clock::now();
  EXPECT_THAT(CreateHelp(hanging, /*time_limit_s=*/0.2),
              HasSubstr("passed on to " + hanging));
  // Far from 600 s even on a busy machine.
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(60));
  unsetenv("DGSFM_COLMAP_VISITED");

  const std::string broken = WriteScript("broken", "");
  std::ofstream(broken) << "#!/no/such/shell\n";
  environment_["DGSFM_COLMAP_EXE"] = broken;
  EXPECT_EQ(Run({"help"}).code, 0);
  const Result other = Run({"mapper"});
  EXPECT_EQ(other.code, 1);
  EXPECT_THAT(other.err, HasSubstr("cannot run " + broken));
}

TEST_F(ColmapExecutable, EveryCommandShowsHelpAndRejectsUnknownOptions) {
  for (const Command& command : Commands()) {
    const Result help = Run({command.name, "--help"});
    EXPECT_EQ(help.code, 0) << command.name;
    EXPECT_THAT(help.out, HasSubstr("colmap " + command.name + ": "));
    const Result unknown = Run({command.name, "--no_such_option", "1"});
    EXPECT_EQ(unknown.code, 2) << command.name;
    EXPECT_THAT(unknown.err, HasSubstr("no_such_option"));
    EXPECT_EQ(Run({command.name}).code, 2) << command.name;
  }
}

TEST_F(ColmapExecutable, EvaluatesModelAndReportsMissingOne) {
  const std::string model = dir_ + "/model";
  fs::create_directory(model);
  CreateRingModel(3).WriteBinary(model);
  const Result good = Run(
      {"model_evaluator", "--input_path", dir_, "--ground_truth_path", model});
  EXPECT_EQ(good.code, 0) << good.err;
  EXPECT_THAT(good.out, HasSubstr("AUC@1: 100.00"));
  const Result bad = Run({"model_evaluator",
                          "--input_path",
                          dir_ + "/none",
                          "--ground_truth_path",
                          model});
  EXPECT_EQ(bad.code, 1);
  EXPECT_THAT(bad.err, HasSubstr("ERROR: model folder " + dir_ + "/none"));
  EXPECT_EQ(bad.out, "");
}

}  // namespace
}  // namespace dgsfm
