// The commands of the executable. Each takes the arguments after its own name
// (argv[0] is the program), writes its result to stdout, its log to stderr,
// and returns 0 on success, 1 on failure, 2 on wrong usage. RunCommand adds
// the translation of exceptions to message and exit code.

#pragma once

#include <string>
#include <vector>

namespace dgsfm {

int RunDenseMatchImporter(int argc, char** argv);
int RunDepthImporter(int argc, char** argv);
int RunDepthExporter(int argc, char** argv);
int RunDepthGeometricVerifier(int argc, char** argv);
int RunViewGraphPartitioner(int argc, char** argv);
int RunPairGeometryMerger(int argc, char** argv);
int RunDepthGlobalMapper(int argc, char** argv);
int RunModelJoiner(int argc, char** argv);
int RunModelEvaluator(int argc, char** argv);
int RunModelRenderer(int argc, char** argv);
int RunModelReporter(int argc, char** argv);
int RunDepthSceneSynthesizer(int argc, char** argv);
int RunCommandDocuments(int argc, char** argv);

struct Command {
  std::string name;
  std::string summary;
  int (*run)(int argc, char** argv);
};

// Those for users, in the order of the help text.
const std::vector<Command>& Commands();

// A command of users, or command_documents, which only builds call; null for
// other names.
const Command* FindCommand(const std::string& name);

// Runs a command and turns its exceptions into "ERROR: ..." on stderr and
// exit code 1, or 2 for a UsageError.
int RunCommand(const Command& command, int argc, char** argv);

}  // namespace dgsfm
