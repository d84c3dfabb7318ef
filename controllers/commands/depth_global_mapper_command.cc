#include "controllers/commands/commands.h"
#include "controllers/global_depth_mapper.h"

#include <functional>
#include <iostream>
#include <optional>
#include <string>

namespace dgsfm {

namespace {

int RunMapper(int argc,
              char** argv,
              const std::string& command,
              const std::string& summary,
              const std::function<void(GlobalDepthMapperOptions*,
                                       CommandOptions*)>& bind) {
  GlobalDepthMapperOptions options;
  std::optional<int> exit_code;
  SetOverPreset(
      [&] {
        CommandOptions command_options(command, summary);
        bind(&options, &command_options);
        exit_code = command_options.Parse(argc, argv);
      },
      &options);
  if (exit_code) return *exit_code;
  const GlobalDepthMapperSummary result = GlobalDepthMapper(options).Run();
  std::cout << result.text << std::flush;
  if (!result.model_paths.empty()) return 0;
  std::cerr << "ERROR: " << result.FailureText() << std::endl;
  return 1;
}

}  // namespace

int RunDepthGlobalMapper(int argc, char** argv) {
  return RunMapper(argc,
                   argv,
                   "depth_global_mapper",
                   "Reconstructs a database with depth priors by global "
                   "structure from motion.",
                   [](auto* options, auto* command_options) {
                     BindOptions(options, command_options);
                   });
}

int RunModelJoiner(int argc, char** argv) {
  return RunMapper(argc,
                   argv,
                   "model_joiner",
                   "Joins models of overlapping parts of a database by the "
                   "images they share, and adjusts the result.",
                   [](auto* options, auto* command_options) {
                     BindPartJoining(options, command_options);
                     BindOptions(options, command_options);
                   });
}

}  // namespace dgsfm
