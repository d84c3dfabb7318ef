// The executable `colmap`: commands of this project.

#include "controllers/commands.h"

#include <iostream>
#include <string>

#include <glog/logging.h>

int main(int argc, char** argv) {
  FLAGS_logtostderr = true;
  google::InitGoogleLogging(argv[0]);
  const std::string name = argc > 1 ? argv[1] : "help";
  for (const dgsfm::Command& command : dgsfm::Commands()) {
    if (command.name != name) continue;
    argv[1] = argv[0];
    return dgsfm::RunCommand(command, argc - 1, argv + 1);
  }
  std::cerr << "ERROR: unknown command " << name << std::endl;
  return 2;
}
