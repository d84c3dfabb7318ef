// What a stage did: part of the story in the log, in detail at verbosity 1,
// and written to report.json.

#pragma once

#include "colmap_ext/pair_geometry.h"

#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace dgsfm {

// Begins the names of the figures that count pairs by the status by which a
// stage took them out.
inline const std::string kFilteredPrefix = "filtered_";

struct StageReport {
  std::string stage;
  // Counts in and out and other figures, in the order they were added.
  std::vector<std::pair<std::string, double>> figures;
  double seconds = 0;
  // Processor time of all threads.
  double cpu_seconds = 0;
  // Largest resident memory of the process so far.
  double peak_memory_mb = 0;
};

// A stage from construction, which throws Cancelled if it is, to Finish().
class StageTimer {
 public:
  explicit StageTimer(const std::string& stage);
  StageTimer& Add(const std::string& figure, double value);
  // The number of pairs of each kind, degeneracies as "valid_...".
  StageTimer& Add(const PairTotals& totals);
  // Appends the stage to the reports and logs the sentences that it completes.
  void Finish(std::vector<StageReport>* reports);

 private:
  StageReport report_;
  std::chrono::steady_clock::time_point start_;
  double cpu_start_;
};

}  // namespace dgsfm
