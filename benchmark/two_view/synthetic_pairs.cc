// Accuracy of the two-view estimator over a grid of synthetic image pairs:
// outliers x depth noise x what is known of the focal lengths, useless depth,
// and special motions. Prints a Markdown table.
//
//   synthetic_pairs [NUM_PAIRS [FILTER [paper]]]
//
// runs the rows whose name contains FILTER; "paper" takes the published
// estimator.

#include <cstdlib>
#include <string>
#include <vector>

#include "benchmark/two_view/pair_statistics.h"

namespace dgsfm {
namespace {

enum class Depth { GIVEN, NONE, PERMUTED };

struct Row {
  std::string name;
  TwoViewSceneOptions scene;
  FocalCase focal_case = FocalCase::TWO;
  Depth depth = Depth::GIVEN;
};

constexpr struct {
  FocalCase value;
  const char* name;
} kFocalCases[] = {{FocalCase::TWO, "two focals"},
                   {FocalCase::SHARED, "shared focal"},
                   {FocalCase::ONE_SIDED1, "one-sided"},
                   {FocalCase::KNOWN, "calibrated"}};

std::string Percents(const TwoViewSceneOptions& scene) {
  return std::to_string(std::lround(100 * scene.outlier_ratio)) + " % / " +
         std::to_string(std::lround(100 * scene.log_depth_stddev)) + " %";
}

std::vector<Row> Rows() {
  std::vector<Row> rows;
  const auto add = [&rows](const std::string& name, const Row& row) {
    rows.push_back(row);
    rows.back().name = name + ", " + Percents(row.scene);
  };
  for (const auto& focal_case : kFocalCases) {
    const std::string name = focal_case.name;
    Row row;
    row.focal_case = focal_case.value;
    for (const double outlier_ratio : {0.3, 0.6}) {
      for (const double log_depth_stddev : {0.03, 0.1, 0.2}) {
        row.scene.outlier_ratio = outlier_ratio;
        row.scene.log_depth_stddev = log_depth_stddev;
        add(name, row);
      }
      row.scene.log_depth_stddev = 0.1;
      row.depth = Depth::NONE;
      add(name + " without depth", row);
      row.depth = Depth::PERMUTED;
      add(name + " useless depth", row);
      row.depth = Depth::GIVEN;
    }
    row.scene.num_matches = 2000;
    add(name + " 2000 matches", row);
    row.scene = TwoViewSceneOptions();
    row.scene.orbit = false;
    row.scene.baseline_ratio = 0.03;
    add(name + " low parallax", row);
    row.scene.baseline_ratio = 0;
    add(name + " pure rotation", row);
    row.scene.baseline_ratio = 0.15;
    row.scene.max_rotation_deg = 0;
    add(name + " pure translation", row);
    row.scene = TwoViewSceneOptions();
    row.scene.planar = true;
    add(name + " planar", row);
  }
  return rows;
}

void Run(const Row& row, int num_pairs, const TwoViewDepthOptions& options) {
  PairStatistics statistics;
  for (int k = 0; k < num_pairs; ++k) {
    TwoViewScene scene = CreateTwoViewScene(row.scene, row.focal_case, k);
    if (row.depth == Depth::NONE) RemoveDepth(&scene.input);
    if (row.depth == Depth::PERMUTED) PermuteDepth(&scene.input);
    double milliseconds;
    const TwoViewDepthResult result =
        EstimateTimed(scene.input, options, &milliseconds);
    statistics.Add(
        result, scene.truth, row.depth == Depth::GIVEN, milliseconds);
  }
  statistics.Print(row.name);
}

}  // namespace
}  // namespace dgsfm

int main(int argc, char** argv) {
  const int num_pairs = argc > 1 ? std::atoi(argv[1]) : 200;
  const std::string filter = argc > 2 ? argv[2] : "";
  dgsfm::TwoViewDepthOptions options;
  options.max_epipolar_error_px = 2;  // twice the noise of the points
  options.paper = argc > 3 && std::string(argv[3]) == "paper";
  dgsfm::PairStatistics::PrintHeader("outliers / depth noise");
  for (const dgsfm::Row& row : dgsfm::Rows()) {
    if (row.name.find(filter) == std::string::npos) continue;
    dgsfm::Run(row, num_pairs, options);
  }
  return 0;
}
