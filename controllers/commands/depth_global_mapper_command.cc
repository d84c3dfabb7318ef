#include "controllers/commands/commands.h"
#include "controllers/global_depth_mapper.h"

#include <iostream>
#include <optional>

namespace dgsfm {

int RunDepthGlobalMapper(int argc, char** argv) {
  GlobalDepthMapperOptions options;
  std::optional<int> exit_code;
  SetOverPreset(
      [&] {
        CommandOptions command_options(
            "depth_global_mapper",
            "Reconstructs a database with depth priors by global structure "
            "from motion.");
        BindOptions(&options, &command_options);
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

}  // namespace dgsfm
