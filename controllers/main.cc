// The executable `colmap`: our commands, and those of a COLMAP on the machine.

#include "controllers/colmap_delegate.h"

#include <glog/logging.h>

int main(int argc, char** argv) {
  FLAGS_logtostderr = true;
  google::InitGoogleLogging(argv[0]);
  return dgsfm::RunColmap(argc, argv);
}
