// The executable `colmap`: our commands, and those of a COLMAP on the machine.

#include "controllers/commands/colmap_delegate.h"
#include "controllers/commands/command_log.h"

#include <csignal>

#include <fcntl.h>
#include <glog/logging.h>
#include <unistd.h>

int main(int argc, char** argv) {
  // A file beyond the user's limit (ulimit -f) is an error of the write.
  std::signal(SIGXFSZ, SIG_IGN);
  // Where a standard stream is closed, the next file would take its place and
  // get what is written to it. Opened for reading, writing to it fails.
  int descriptor = 0;
  while (descriptor >= 0 && descriptor <= STDERR_FILENO) {
    descriptor = open("/dev/null", O_RDONLY);
  }
  close(descriptor);
  google::InitGoogleLogging(argv[0]);
  dgsfm::LogToStderr();
  return dgsfm::RunColmap(argc, argv);
}
