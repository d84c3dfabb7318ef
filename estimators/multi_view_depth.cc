#include "estimators/multi_view_depth.h"

#include "colmap_ext/check.h"
#include "colmap_ext/parallel.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {
namespace {

constexpr int kNumReweightings = 3;
// Pixels along the longer side of a map that FindAgreements() compares.
constexpr int kNumAgreementsPerSide = 48;

// Robust weighted mean of the logarithms, with 0 for the pixel's own.
struct LogMean {
  struct Term {
    double log_ratio;
    double weight;
    double stddev;
  };

  std::vector<Term> terms;

  double Compute() const {
    double mean = 0;
    for (int iteration = 0; iteration <= kNumReweightings; ++iteration) {
      double sum = 0;
      double weight_sum = 0;
      for (const Term& term : terms) {
        const double deviation =
            (term.log_ratio - mean) / (kEfficientCauchyWidth * term.stddev);
        const double weight = iteration == 0
                                  ? term.weight
                                  : term.weight / (1 + deviation * deviation);
        sum += weight * term.log_ratio;
        weight_sum += weight;
      }
      mean = sum / weight_sum;
    }
    return mean;
  }
};

// What all neighbours show of a pixel.
struct Votes {
  int num_agreeing = 0;
  int num_contradicting = 0;
  // Log depth that agreeing views have together, less the pixel's.
  double log_ratio = 0;

  float Confidence() const {
    return (num_agreeing + 0.5f) / (num_agreeing + num_contradicting + 1);
  }
};

class Comparisons {
 public:
  // Depths agree up to max_deviation [standard deviations of both views], and
  // up to max_difference of the options at most.
  Comparisons(const DepthView& view,
              const std::vector<const DepthView*>& neighbors,
              const MultiViewDepthOptions& options,
              double max_deviation)
      : view_(view) {
    std::string error;
    DGSFM_CHECK(options.IsValid(&error)) << error;
    for (const DepthView* neighbor : neighbors) {
      const double stddev = std::hypot(view.Stddev(), neighbor->Stddev());
      comparisons_.emplace_back(
          view,
          *neighbor,
          std::min(options.max_difference, max_deviation * stddev));
    }
  }
  size_t Size() const { return comparisons_.size(); }
  ViewComparison* At(size_t i) { return &comparisons_[i]; }

  Votes Count(int x, int y) const {
    Votes votes;
    const Eigen::Vector3d plane = view_.TangentPlane(x, y);
    LogMean mean;
    mean.terms.push_back({0, Weight(view_), view_.Stddev()});
    for (const ViewComparison& comparison : comparisons_) {
      double log_ratio = 0;
      const ViewVerdict verdict = comparison.Judge(x, y, plane, &log_ratio);
      votes.num_contradicting += verdict == ViewVerdict::CONTRADICTS;
      if (verdict != ViewVerdict::AGREES) continue;
      ++votes.num_agreeing;
      if (std::isnan(log_ratio)) continue;
      mean.terms.push_back({log_ratio,
                            Weight(comparison.Neighbor()),
                            comparison.MaxDifference() / kMaxDeviation});
    }
    if (votes.num_agreeing == 0 && (plane.isZero() || view_.IsAtEdge(x, y))) {
      ++votes.num_contradicting;
    }
    votes.log_ratio = mean.Compute();
    return votes;
  }

 private:
  static double Weight(const DepthView& view) {
    return 1 / (view.Stddev() * view.Stddev());
  }

  const DepthView& view_;
  std::vector<ViewComparison> comparisons_;
};

struct PixelCounts {
  size_t known = 0;
  size_t agreeing = 0;
  size_t dropped = 0;
};

PixelCounts RefineRow(const Comparisons& comparisons,
                      double min_confidence,
                      int y,
                      RefinedDepth* refined) {
  PixelCounts counts;
  const int width = refined->depth_map.width;
  for (int x = 0; x < width; ++x) {
    const size_t i = size_t(y) * width + x;
    float& depth = refined->depth_map.values[i];
    if (depth <= 0) continue;
    const Votes votes = comparisons.Count(x, y);
    refined->confidence[i] = votes.Confidence();
    ++counts.known;
    counts.agreeing += votes.num_agreeing > 0;
    if (votes.Confidence() < min_confidence) {
      depth = 0;
      ++counts.dropped;
    } else {
      depth *= static_cast<float>(std::exp(votes.log_ratio));
    }
  }
  return counts;
}

}  // namespace

bool MultiViewDepthOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Within("max_difference", max_difference, 1e-3, 1)
      .Within("min_confidence", min_confidence, 0, 1)
      .AreKept();
}

RefinedDepth RefineDepth(const DepthView& view,
                         const std::vector<const DepthView*>& neighbors,
                         const MultiViewDepthOptions& options,
                         int num_threads) {
  Comparisons comparisons(view, neighbors, options, kMaxDeviation);
  ParallelFor(comparisons.Size(), num_threads, [&](size_t i) {
    comparisons.At(i)->FindSurfacesInFront();
  });
  RefinedDepth refined;
  refined.depth_map = view.Map();
  refined.confidence.assign(view.Map().values.size(), 0);
  std::vector<PixelCounts> rows(view.Map().height);
  ParallelFor(rows.size(), num_threads, [&](size_t y) {
    rows[y] = RefineRow(
        comparisons, options.min_confidence, static_cast<int>(y), &refined);
  });
  PixelCounts sum;
  for (const PixelCounts& row : rows) {
    sum.known += row.known;
    sum.agreeing += row.agreeing;
    sum.dropped += row.dropped;
  }
  if (sum.known > 0) {
    refined.agreeing_ratio = double(sum.agreeing) / sum.known;
    refined.dropped_ratio = double(sum.dropped) / sum.known;
  }
  return refined;
}

std::vector<DepthCorrespondence> FindAgreements(
    const DepthView& view,
    const std::vector<const DepthView*>& neighbors,
    const MultiViewDepthOptions& options) {
  // Before their fields are corrected maps may be off by more than their points
  // show.
  const Comparisons comparisons(view, neighbors, options, 2 * kMaxDeviation);
  const DepthMap& map = view.Map();
  const int step =
      std::max(1, std::max(map.width, map.height) / kNumAgreementsPerSide);
  std::vector<DepthCorrespondence> agreements;
  for (int y = step / 2; y < map.height; y += step) {
    for (int x = step / 2; x < map.width; x += step) {
      if (map.At(x, y) <= 0) continue;
      const Votes votes = comparisons.Count(x, y);
      if (votes.num_agreeing <= votes.num_contradicting) continue;
      agreements.push_back({(x + 0.5) / map.width,
                            (y + 0.5) / map.height,
                            map.At(x, y),
                            map.At(x, y) * std::exp(votes.log_ratio)});
    }
  }
  return agreements;
}

}  // namespace dgsfm
