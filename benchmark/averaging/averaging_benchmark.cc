// Time, memory and accuracy of the averages on large synthetic graphs.
// averaging_benchmark [images [edges [share of false edges [layout]]]]

#include "estimators/median.h"
#include "tests/estimators/averaging_graph.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

#include <sys/resource.h>

namespace dgsfm {
namespace {

double PeakMemoryMb() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss / 1024.0;
}

// Median and largest value.
std::pair<double, double> Summary(std::vector<double> errors) {
  std::sort(errors.begin(), errors.end());
  return {errors[errors.size() / 2], errors.back()};
}

// Runs an average, which returns its errors, none if it fails. Processor time,
// for all run on one thread.
template <typename Function>
void Measure(const char* name, const char* unit, const Function& average) {
  const std::clock_t start = std::clock();
  const std::vector<double> errors = average();
  const double seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
  if (errors.empty()) {
    std::printf("  %-12s failed after %.2f s\n", name, seconds);
    return;
  }
  const auto [median, max] = Summary(errors);
  std::printf(
      "  %-12s %6.2f s, peak %4.0f MB, error: median %.4f %s, largest %.4f "
      "%s\n",
      name,
      seconds,
      PeakMemoryMb(),
      median,
      unit,
      max,
      unit);
  std::fflush(stdout);
}

double AngleDeg(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return a.angularDistance(b) * 180 / M_PI;
}

std::vector<double> RotationErrors(const AveragingGraph& graph,
                                   std::vector<Eigen::Quaterniond>* rotations) {
  std::vector<double> errors;
  if (!AverageRotations(graph.rotations.size(),
                        graph.relative_rotations,
                        0,
                        GraphAveragingOptions(),
                        rotations)) {
    return errors;
  }
  // The gauge in which most agree, of some.
  for (size_t g = 0; g < rotations->size(); g += rotations->size() / 50 + 1) {
    const Eigen::Quaterniond gauge =
        (*rotations)[g].conjugate() * graph.rotations[g];
    std::vector<double> errors_deg;
    for (size_t i = 0; i < rotations->size(); ++i) {
      errors_deg.push_back(
          AngleDeg((*rotations)[i] * gauge, graph.rotations[i]));
    }
    if (errors.empty() || Median(errors_deg) < Median(errors)) {
      errors = errors_deg;
    }
  }
  return errors;
}

std::vector<double> ScaleErrors(const AveragingGraph& graph) {
  std::vector<double> log_scales;
  std::vector<double> errors;
  if (!AverageScales(graph.log_scales.size(),
                     graph.ratios,
                     0,
                     GraphAveragingOptions(),
                     &log_scales)) {
    return errors;
  }
  // The gauge in which most agree: the fixed node may be wrong itself.
  std::vector<double> differences;
  for (size_t i = 0; i < log_scales.size(); ++i) {
    differences.push_back(log_scales[i] - graph.log_scales[i]);
  }
  const double gauge = Median(differences);
  for (const double difference : differences) {
    errors.push_back(std::abs(difference - gauge));
  }
  return errors;
}

// Errors over the edges within 10 degrees of the rotations, which the pipeline
// keeps.
std::vector<double> TranslationErrors(
    const AveragingGraph& graph,
    const std::vector<Eigen::Quaterniond>& rotations) {
  std::vector<RelativeTranslation> translations;
  for (size_t e = 0; e < graph.translations.size(); ++e) {
    const RelativeRotation& relative = graph.relative_rotations[e];
    const Eigen::Quaterniond predicted =
        rotations[relative.node2] * rotations[relative.node1].conjugate();
    if (AngleDeg(predicted, relative.cam2_from_cam1) < 10) {
      translations.push_back(graph.translations[e]);
    }
  }
  std::vector<Eigen::Vector3d> centers;
  std::vector<double> errors;
  if (!AverageTranslations(graph.centers.size(),
                           translations,
                           0,
                           GraphAveragingOptions(),
                           &centers)) {
    return errors;
  }
  for (size_t i = 0; i < centers.size(); ++i) {
    errors.push_back(
        (centers[i] - (graph.centers[i] - graph.centers[0])).norm());
  }
  return errors;
}

// Two estimates per edge, one camera per image.
std::vector<double> FocalErrors(const AveragingGraph& graph) {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  std::vector<std::vector<double>> estimates(graph.rotations.size());
  for (size_t e = 0; e < graph.ratios.size(); ++e) {
    for (const int node : {graph.ratios[e].node1, graph.ratios[e].node2}) {
      estimates[node].push_back((graph.is_false[e] ? 0.7 : 0.05) *
                                normal(random));
    }
  }
  std::vector<double> errors;
  for (const auto& log_errors_of_camera : estimates) {
    errors.push_back(std::abs(Median(log_errors_of_camera)));
  }
  return errors;
}

}  // namespace
}  // namespace dgsfm

int main(int argc, char** argv) {
  using namespace dgsfm;
  AveragingGraphOptions options;
  options.num_nodes = argc > 1 ? std::atoi(argv[1]) : 10000;
  options.num_edges = argc > 2 ? std::atoi(argv[2]) : 500000;
  options.false_ratio = argc > 3 ? std::atof(argv[3]) : 0.3;
  const std::pair<const char*, GraphLayout> layouts[] = {
      {"street", GraphLayout::STREET},
      {"city", GraphLayout::CITY},
      {"random", GraphLayout::RANDOM}};
  for (const auto& [name, layout] : layouts) {
    if (argc > 4 && std::strcmp(argv[4], name) != 0) continue;
    options.layout = layout;
    const AveragingGraph graph = CreateAveragingGraph(options);
    std::printf("%s: %d images, %d edges, %.0f %% false\n",
                name,
                options.num_nodes,
                options.num_edges,
                100 * options.false_ratio);
    Measure("focals", "log", [&] { return FocalErrors(graph); });
    std::vector<Eigen::Quaterniond> rotations;
    Measure(
        "rotations", "deg", [&] { return RotationErrors(graph, &rotations); });
    Measure("scales", "log", [&] { return ScaleErrors(graph); });
    Measure("translations", "m", [&] {
      return TranslationErrors(graph, rotations);
    });
  }
}
