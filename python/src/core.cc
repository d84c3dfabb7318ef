// The module dgsfm._core: the commands as functions. The package around it
// gives them their Python interface and documents them.

#include "colmap_ext/formats/dense_match_file.h"
#include "controllers/commands/colmap_delegate.h"
#include "controllers/commands/import_export_options.h"
#include "controllers/global_depth_mapper.h"
#include "controllers/model_evaluator.h"
#include "controllers/output_folder.h"
#include "controllers/pair_geometry_merger.h"
#include "controllers/pair_shard_verifier.h"

#include <csignal>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "python/src/call.h"
#include "python/src/conversion.h"
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

namespace nb = nanobind;

// Binds options, sets those given, and throws ValueError unless they are valid.
template <typename Options>
void Configure(const nb::dict& values, Options* options) {
  CommandOptions bound("", "");
  BindOptions(options, &bound);
  SetOptions(values, &bound);
  std::string error;
  if (options->IsValid(&error)) return;
  // Some end their lines.
  error.erase(error.find_last_not_of('\n') + 1);
  throw nb::value_error(error.c_str());
}

template <typename Options>
nb::list Describe() {
  Options options;
  CommandOptions bound("", "");
  BindOptions(&options, &bound);
  return DescribeOptions(bound);
}

nb::list DescribeCommand(const std::string& command) {
  if (command == "depth_importer") return Describe<DepthImportOptions>();
  if (command == "dense_match_importer") {
    return Describe<DenseMatchImportOptions>();
  }
  if (command == "depth_geometric_verifier") {
    return Describe<DepthGeometricVerifierOptions>();
  }
  if (command == "depth_global_mapper") {
    return Describe<GlobalDepthMapperOptions>();
  }
  if (command == "depth_exporter") return Describe<DepthExportOptions>();
  throw nb::value_error((command + " has no options here").c_str());
}

nb::dict ImportDepth(const std::string& database_path,
                     const nb::object& depths,
                     const nb::dict& values,
                     const nb::object& progress) {
  DepthImportOptions options;
  Configure(values, &options);
  const bool is_path = nb::isinstance<nb::str>(depths);
  const std::string path = is_path ? nb::cast<std::string>(depths) : "";
  std::map<std::string, DepthFile> files;
  if (!is_path) files = DepthFilesOf(nb::cast<nb::dict>(depths));
  DepthImportSummary summary;
  RunWork(
      [&] {
        summary = is_path ? ImportDepthMaps(database_path, path, options)
                          : ImportDepthMaps(database_path, files, options);
        if (!summary.failed.empty()) {
          throw std::runtime_error(summary.FailureText());
        }
      },
      progress);
  return ToPython(summary);
}

nb::dict ImportMatches(const std::string& database_path,
                       const nb::object& matches,
                       const nb::dict& values,
                       const nb::object& progress) {
  DenseMatchImportOptions options;
  Configure(values, &options);
  const bool is_path = nb::isinstance<nb::str>(matches);
  const std::string path = is_path ? nb::cast<std::string>(matches) : "";
  std::map<std::string, ArrayReader> readers;
  if (!is_path) readers = ReadersOf(nb::cast<nb::dict>(matches));
  DenseMatchImportSummary summary;
  RunWork(
      [&] {
        summary = ImportDenseMatches(
            database_path,
            is_path ? DenseMatchFile(path) : DenseMatchFile("matches", readers),
            options);
      },
      progress);
  return ToPython(summary);
}

nb::dict VerifyDatabase(const std::string& database_path,
                        const nb::dict& values,
                        const nb::object& progress) {
  DepthGeometricVerifierOptions options;
  options.database_path = database_path;
  Configure(values, &options);
  VerificationSummary summary;
  RunWork(
      [&] {
        summary = options.IsShard() ? VerifyPairShard(options)
                                    : VerifyDatabasePairs(options);
      },
      progress);
  return ToPython(summary);
}

nb::dict MergeShards(const std::string& database_path,
                     const std::string& shard_paths,
                     int num_threads,
                     const nb::object& progress) {
  const PairGeometryMergerOptions options = {
      database_path, shard_paths, num_threads};
  VerificationSummary summary;
  RunWork([&] { summary = MergePairShards(options); }, progress);
  return ToPython(summary);
}

nb::dict MapGlobally(const std::string& database_path,
                     const std::string& output_path,
                     const std::string& image_path,
                     const nb::dict& values,
                     const nb::object& progress) {
  GlobalDepthMapperOptions options;
  SetOverPreset(
      [&] {
        CommandOptions bound("", "");
        BindOptions(&options, &bound);
        SetOptions(values, &bound);
      },
      &options);
  options.verifier.database_path = database_path;
  options.output_path = output_path;
  options.image_path = image_path;
  GlobalDepthMapperSummary summary;
  RunWork(
      [&] {
        summary = GlobalDepthMapper(options).Run();
        if (summary.model_paths.empty()) {
          throw std::runtime_error(summary.FailureText());
        }
      },
      progress);
  return ToPython(summary);
}

nb::dict ExportDepth(const std::string& database_path,
                     const std::string& output_path,
                     const std::string& model_path,
                     const nb::dict& values,
                     const nb::object& progress) {
  DepthExportOptions options;
  Configure(values, &options);
  if (model_path.empty() && !options.undistorted_path.empty()) {
    throw nb::value_error("undistorted_path needs input_path");
  }
  DepthExportSummary summary;
  RunWork(
      [&] {
        summary = ExportDepthMaps(
            database_path,
            model_path.empty() ? std::nullopt : std::make_optional(model_path),
            output_path,
            options);
      },
      progress);
  return ToPython(summary);
}

// JSON, as the command writes it.
std::string Evaluate(const std::string& model_path,
                     const std::string& ground_truth_path,
                     const std::vector<double>& thresholds_deg) {
  std::string text;
  RunWork(
      [&] {
        text = JsonText(ToJson(EvaluateModel(
                            model_path, ground_truth_path, thresholds_deg)),
                        2);
      },
      nb::none());
  return text;
}

int RunProgram(std::vector<std::string> arguments) {
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  LogToStderr();
  // As the program has them; Python ignores broken pipes.
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGPIPE, SIG_DFL);
  std::signal(SIGXFSZ, SIG_IGN);
  const nb::gil_scoped_release release;
  return RunColmap(static_cast<int>(arguments.size()), argv.data());
}

}  // namespace
}  // namespace dgsfm

NB_MODULE(_core, module) {
  using nanobind::arg;
  dgsfm::KeepLogForPython();
  module.def("describe_options", &dgsfm::DescribeCommand, arg("command"));
  module.def("import_depth",
             &dgsfm::ImportDepth,
             arg("database_path"),
             arg("depths"),
             arg("options"),
             arg("progress").none());
  module.def("import_dense_matches",
             &dgsfm::ImportMatches,
             arg("database_path"),
             arg("matches"),
             arg("options"),
             arg("progress").none());
  module.def("verify_pairs",
             &dgsfm::VerifyDatabase,
             arg("database_path"),
             arg("options"),
             arg("progress").none());
  module.def("merge_shards",
             &dgsfm::MergeShards,
             arg("database_path"),
             arg("shard_paths"),
             arg("num_threads"),
             arg("progress").none());
  module.def("global_depth_mapping",
             &dgsfm::MapGlobally,
             arg("database_path"),
             arg("output_path"),
             arg("image_path"),
             arg("options"),
             arg("progress").none());
  module.def("export_depth",
             &dgsfm::ExportDepth,
             arg("database_path"),
             arg("output_path"),
             arg("input_path"),
             arg("options"),
             arg("progress").none());
  module.def("evaluate",
             &dgsfm::Evaluate,
             arg("input_path"),
             arg("ground_truth_path"),
             arg("thresholds_deg"));
  module.def("run_program", &dgsfm::RunProgram, arg("arguments"));
}
