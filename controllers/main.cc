// The executable `colmap`: our commands, and those of a COLMAP on the machine.

#include "controllers/colmap_delegate.h"

#include <csignal>

#include <glog/logging.h>

int main(int argc, char** argv) {
  // A file beyond the user's limit (ulimit -f) is an error of the write.
  std::signal(SIGXFSZ, SIG_IGN);
  FLAGS_logtostderr = true;
  google::InitGoogleLogging(argv[0]);
  return dgsfm::RunColmap(argc, argv);
}
