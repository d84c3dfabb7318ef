#include "controllers/commands/colmap_delegate.h"

#include "controllers/commands/commands.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <future>
#include <iomanip>
#include <iostream>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include <boost/asio/io_context.hpp>
#include <boost/process.hpp>
#include <unistd.h>

namespace dgsfm {
namespace {

namespace bp = boost::process;
namespace fs = std::filesystem;

constexpr char kExeVariable[] = "DGSFM_COLMAP_EXE";
constexpr char kVisitedVariable[] = "DGSFM_COLMAP_VISITED";

std::vector<std::string> SplitPaths(const char* paths) {
  std::vector<std::string> items;
  std::istringstream stream(paths != nullptr ? paths : "");
  for (std::string item; std::getline(stream, item, ':');) {
    if (!item.empty()) items.push_back(item);
  }
  return items;
}

// This program and all that led to it.
std::vector<std::string> Visited() {
  std::vector<std::string> visited = SplitPaths(std::getenv(kVisitedVariable));
  visited.push_back(fs::read_symlink("/proc/self/exe").string());
  return visited;
}

bool IsVisited(const std::string& path,
               const std::vector<std::string>& visited) {
  return std::any_of(
      visited.begin(), visited.end(), [&path](const std::string& other) {
        std::error_code error;  // a visited file may have disappeared
        return fs::equivalent(path, other, error);
      });
}

bool IsExecutable(const std::string& path) {
  std::error_code error;
  return fs::is_regular_file(path, error) && access(path.c_str(), X_OK) == 0;
}

// The next program to run finds this one and `colmap` listed as tried.
void MarkVisited(const std::string& colmap) {
  std::string paths;
  for (const std::string& path : Visited()) paths += path + ":";
  setenv(kVisitedVariable, (paths + colmap).c_str(), /*replace=*/1);
}

// What `colmap help` prints, as far as it comes within the time limit.
std::string ReadColmapHelp(const std::string& colmap, double time_limit_s) {
  boost::asio::io_context context;
  std::future<std::string> output;
  std::error_code error;
  bp::group group;
  bp::child child(colmap,
                  "help",
                  group,
                  context,
                  error,
                  bp::std_in<bp::null, bp::std_out> output,
                  bp::std_err > bp::null);
  if (error) return "";
  context.run_for(std::chrono::duration_cast<std::chrono::milliseconds>(
      std::chrono::duration<double>(time_limit_s)));
  group.terminate(error);  // nothing to end if it is over
  child.wait(error);
  const bool is_complete =
      output.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  return is_complete ? output.get() : "";
}

int RunOrThrow(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "help";
  if (const Command* command = FindCommand(name)) {
    argv[1] = argv[0];
    return RunCommand(*command, argc - 1, argv + 1);
  }
  const std::optional<std::string> colmap = FindColmap();
  if (name == "help" || name == "--help" || name == "-h") {
    const Command help = {"help", "", [](int, char**) {
                            std::cout << CreateHelp(FindColmap());
                            return 0;
                          }};
    return RunCommand(help, argc, argv);
  }
  if (colmap) ExecColmap(*colmap, argv);
  std::cerr << "ERROR: " << name
            << " is no command of this program, and no COLMAP was found that "
               "might know it. Install one (on Debian: apt install colmap) or "
               "name it in the environment variable "
            << kExeVariable << ". See: colmap help" << std::endl;
  return 1;
}

}  // namespace

std::optional<std::string> FindColmap() {
  const std::vector<std::string> visited = Visited();
  if (const char* named = std::getenv(kExeVariable);
      named != nullptr && *named != '\0') {
    if (!IsExecutable(named)) {
      throw std::runtime_error(std::string(kExeVariable) + "=" + named +
                               " is no executable file");
    }
    if (IsVisited(named, visited)) {
      throw std::runtime_error(std::string(kExeVariable) + "=" + named +
                               " leads back to this program");
    }
    return fs::absolute(named).string();
  }
  std::vector<std::string> folders = SplitPaths(std::getenv("PATH"));
  folders.insert(folders.end(), {"/usr/local/bin", "/usr/bin"});
  for (const std::string& folder : folders) {
    const std::string path = fs::absolute(folder) / "colmap";
    if (IsExecutable(path) && !IsVisited(path, visited)) return path;
  }
  return std::nullopt;
}

ColmapHelp ParseColmapHelp(const std::string& text) {
  static const std::regex version_pattern("COLMAP v?([0-9][0-9A-Za-z.+-]*)");
  static const std::regex command_pattern("\\s+([a-z][a-z0-9_]*)\\s*");
  ColmapHelp help;
  std::smatch match;
  if (std::regex_search(text, match, version_pattern)) help.version = match[1];
  std::istringstream stream(text);
  bool is_list = false;
  for (std::string line; std::getline(stream, line);) {
    if (line.rfind("Available commands", 0) == 0) {
      is_list = true;
    } else if (is_list && std::regex_match(line, match, command_pattern)) {
      if (match[1] != "help") help.commands.push_back(match[1]);
    }
  }
  return help;
}

std::string CreateHelp(const std::optional<std::string>& colmap,
                       double time_limit_s) {
  std::ostringstream text;
  text << "DGSFM -- Structure-from-Motion with depth priors for COLMAP\n\n"
       << "Usage:\n"
       << "  colmap [command] [options]\n"
       << "  colmap [command] --help\n\n"
       << "Commands of DGSFM:\n";
  for (const Command& command : Commands()) {
    text << "  " << std::left << std::setw(26) << command.name
         << command.summary << "\n";
  }
  if (!colmap) {
    text << "\nNo COLMAP was found for other commands: install one (on Debian: "
            "apt install\ncolmap) or name it in the environment variable "
         << kExeVariable << ".\n";
    return text.str();
  }
  MarkVisited(*colmap);
  const ColmapHelp help =
      ParseColmapHelp(ReadColmapHelp(*colmap, time_limit_s));
  if (help.commands.empty()) {
    text << "\nOther commands are passed on to " << *colmap
         << ", which does not list them.\n";
    return text.str();
  }
  text << "\nAvailable commands of COLMAP " << help.version << " (" << *colmap
       << "):\n";
  for (const std::string& command : help.commands) {
    text << "  " << command << "\n";
  }
  return text.str();
}

void ExecColmap(const std::string& colmap, char** argv) {
  MarkVisited(colmap);
  argv[0] = const_cast<char*>(colmap.c_str());
  execv(colmap.c_str(), argv);
  throw std::runtime_error("cannot run " + colmap + ": " +
                           std::strerror(errno));
}

int RunColmap(int argc, char** argv) {
  try {
    return RunOrThrow(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "ERROR: " << error.what() << std::endl;
  }
  return 1;
}

}  // namespace dgsfm
