#include "controllers/commands/commands.h"

#include "controllers/commands/command_options.h"

#include <exception>
#include <iostream>
#include <new>
#include <stdexcept>

namespace dgsfm {

const std::vector<Command>& Commands() {
  static const std::vector<Command> commands = {
      {"depth_importer",
       "stores depth maps in the database",
       &RunDepthImporter},
      {"dense_match_importer",
       "stores correspondences of dense matchers",
       &RunDenseMatchImporter},
      {"depth_geometric_verifier",
       "verifies image pairs with depth",
       &RunDepthGeometricVerifier},
      {"pair_geometry_merger",
       "stores the results of verification in shards",
       &RunPairGeometryMerger},
      {"depth_global_mapper",
       "reconstructs a database with depth priors",
       &RunDepthGlobalMapper},
      {"view_graph_partitioner",
       "divides images into parts that are mapped by themselves",
       &RunViewGraphPartitioner},
      {"model_joiner", "joins models of such parts", &RunModelJoiner},
      {"depth_exporter",
       "writes depth maps, aligned to a model",
       &RunDepthExporter},
      {"model_evaluator",
       "compares camera poses with ground truth",
       &RunModelEvaluator},
      {"model_renderer",
       "draws points and cameras of a model",
       &RunModelRenderer},
      {"model_reporter",
       "writes a page to look at a model in a browser",
       &RunModelReporter},
      {"depth_scene_synthesizer",
       "writes a synthetic scene with exact truth",
       &RunDepthSceneSynthesizer},
  };
  return commands;
}

const Command* FindCommand(const std::string& name) {
  static const Command documents = {
      "command_documents",
      "writes man pages, completions and a list of all options",
      &RunCommandDocuments};
  for (const Command& command : Commands()) {
    if (command.name == name) return &command;
  }
  return name == documents.name ? &documents : nullptr;
}

int RunCommand(const Command& command, int argc, char** argv) {
  try {
    const int exit_code = command.run(argc, argv);
    if (!std::cout.flush()) {
      throw std::runtime_error("cannot write to the standard output");
    }
    return exit_code;
  } catch (const UsageError& error) {
    std::cerr << "ERROR: " << error.what() << "\nSee: colmap " << command.name
              << " --help" << std::endl;
    return 2;
  } catch (const std::bad_alloc&) {
    std::cerr << "ERROR: out of memory" << std::endl;
  } catch (const std::exception& error) {
    std::cerr << "ERROR: " << error.what() << std::endl;
  }
  return 1;
}

}  // namespace dgsfm
