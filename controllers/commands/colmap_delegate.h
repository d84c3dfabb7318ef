// Commands of COLMAP itself: found on the machine, listed beside ours, and
// run in place of this program.
//
// The COLMAP is the one named by the environment variable DGSFM_COLMAP_EXE, or
// else the first executable `colmap` of PATH, /usr/local/bin and /usr/bin that
// is not this program. A `colmap` may also be a script that calls this
// program: the variable DGSFM_COLMAP_VISITED carries what has been tried from
// process to process, so that the search goes on behind it and always ends.

#pragma once

#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

// Path of a COLMAP, or nothing if there is none. Throws std::runtime_error if
// DGSFM_COLMAP_EXE names no executable file or leads back to this program.
std::optional<std::string> FindColmap();

struct ColmapHelp {
  std::string version;  // such as "3.8"; empty if not recognised
  std::vector<std::string> commands;
};

// Reads the output of `colmap help` of COLMAP 3.8 to 4.2.
ColmapHelp ParseColmapHelp(const std::string& text);

// Help text of this program: our commands, then those of `colmap`, which gets
// `time_limit_s` to name them.
std::string CreateHelp(const std::optional<std::string>& colmap,
                       double time_limit_s = 10);

// Replaces this process by COLMAP with the same arguments, streams and signal
// handling. Throws std::runtime_error if it cannot be started.
[[noreturn]] void ExecColmap(const std::string& colmap, char** argv);

// What `main` does: runs one of our commands, the help text, or COLMAP.
int RunColmap(int argc, char** argv);

}  // namespace dgsfm
