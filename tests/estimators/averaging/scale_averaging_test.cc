#include "estimators/averaging/scale_averaging.h"

#include "estimators/median.h"
#include "tests/estimators/averaging_graph.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using testing::DoubleEq;
using testing::ElementsAre;

struct ProblemOptions {
  int num_nodes = 40;
  double edge_probability = 0.4;
  double noise_stddev = 0;
  // Share of edges that are off by a factor of up to e^3.
  double outlier_ratio = 0;
  int seed = 1;
};

struct Problem {
  std::vector<double> truth;
  std::vector<RelativeLogScale> ratios;

  double MaxError(const std::vector<double>& log_scales) const {
    double max_error = 0;
    for (size_t i = 0; i < truth.size(); ++i) {
      max_error = std::max(max_error, std::abs(log_scales[i] - truth[i]));
    }
    return max_error;
  }
};

// Truth in the gauge of node 0.
Problem CreateProblem(const ProblemOptions& options) {
  std::mt19937 random(options.seed);
  std::uniform_real_distribution<double> uniform;
  std::normal_distribution<double> normal;
  Problem problem;
  problem.truth.push_back(0);
  for (int i = 1; i < options.num_nodes; ++i) {
    problem.truth.push_back(2 * uniform(random) - 1);
  }
  for (int i = 0; i < options.num_nodes; ++i) {
    for (int j = i + 1; j < options.num_nodes; ++j) {
      const bool in_chain = j == i + 1;
      if (!in_chain && uniform(random) > options.edge_probability) continue;
      double log_ratio = problem.truth[j] - problem.truth[i] +
                         options.noise_stddev * normal(random);
      const double offset = 3 * (2 * uniform(random) - 1);
      if (!in_chain && uniform(random) < options.outlier_ratio) {
        log_ratio += offset;
      }
      problem.ratios.push_back({i, j, log_ratio});
      if (uniform(random) < 0.5) problem.ratios.back() = {j, i, -log_ratio};
    }
  }
  return problem;
}

std::vector<double> Average(const Problem& problem) {
  std::vector<double> log_scales;
  EXPECT_TRUE(
      AverageScales(problem.truth.size(), problem.ratios, 0, {}, &log_scales));
  return log_scales;
}

TEST(ScaleAveraging, RecoversExactScalesWithoutNoise) {
  const Problem problem = CreateProblem({});
  // A linear system of condition < 100.
  EXPECT_LT(problem.MaxError(Average(problem)), 1e-12);
}

TEST(ScaleAveraging, RecoversScalesUnderThirtyPercentOutliers) {
  for (int seed = 0; seed < 20; ++seed) {
    ProblemOptions options;
    options.outlier_ratio = 0.3;
    options.seed = seed;
    const Problem problem = CreateProblem(options);
    // The pull of an outlier is at most 0.33 loss scales, where it is 0.06
    // off; among ten inliers that moves a node by 0.003. Up to five meet at
    // one node and the gauge node.
    EXPECT_LT(problem.MaxError(Average(problem)), 0.015) << "seed " << seed;
  }
}

TEST(ScaleAveraging, NoiseIsAveragedDown) {
  ProblemOptions options;
  options.noise_stddev = 0.03;
  options.outlier_ratio = 0.2;
  const Problem problem = CreateProblem(options);
  const std::vector<double> log_scales = Average(problem);
  double sum = 0;
  for (size_t i = 0; i < log_scales.size(); ++i) {
    sum += std::pow(log_scales[i] - problem.truth[i], 2);
  }
  // 0.03 / sqrt(13 inliers per node), sqrt(2) of it with the gauge node's
  // own: 0.012; a gauge node two standard deviations off doubles that.
  EXPECT_LT(std::sqrt(sum / log_scales.size()), 0.024);
}

TEST(ScaleAveraging, RecoversScalesUnderThirtyPercentFactorsOfThree) {
  for (const GraphLayout layout :
       {GraphLayout::STREET, GraphLayout::CITY, GraphLayout::RANDOM}) {
    AveragingGraphOptions options;
    options.layout = layout;
    options.num_nodes = 200;
    options.num_edges = 4000;
    options.log_scale_noise = 0.02;
    options.false_neighbors = true;
    const AveragingGraph graph = CreateAveragingGraph(options);
    std::vector<double> log_scales;
    ASSERT_TRUE(
        AverageScales(options.num_nodes, graph.ratios, 0, {}, &log_scales));
    std::vector<double> errors;
    for (int i = 0; i < options.num_nodes; ++i) {
      errors.push_back(log_scales[i] - graph.log_scales[i]);
    }
    const double gauge = Median(errors);
    double max_error = 0;
    for (const double error : errors) {
      max_error = std::max(max_error, std::abs(error - gauge));
    }
    // 28 right ratios per image leave 0.02 / sqrt(28) = 0.004, five times that
    // at the end of a street, where there are 14 and errors add up.
    EXPECT_LT(max_error, 0.02) << int(layout);
  }
}

TEST(ScaleAveraging, PreciseEdgeWinsOverCoarseOne) {
  std::vector<double> log_scales;
  ASSERT_TRUE(AverageScales(
      2, {{0, 1, 1.00, 0.03}, {1, 0, -1.01, 0.09}}, 0, {}, &log_scales));
  // Weighted mean 1.001; the coarse edge at a tenth of its standard deviation
  // counts for 0.2 % less than its weight.
  EXPECT_NEAR(log_scales[1], 1.001, 3e-5);
}

TEST(ScaleAveraging, FixedNodeOnlyShiftsLogScales) {
  ProblemOptions options;
  options.noise_stddev = 0.03;
  options.outlier_ratio = 0.2;
  const Problem problem = CreateProblem(options);
  GraphAveragingOptions averaging_options;
  averaging_options.max_num_irls_iterations = 300;
  averaging_options.convergence_threshold = 1e-9;
  const int num_nodes = problem.truth.size();
  std::vector<double> scales1, scales2;
  ASSERT_TRUE(
      AverageScales(num_nodes, problem.ratios, 0, averaging_options, &scales1));
  ASSERT_TRUE(
      AverageScales(num_nodes, problem.ratios, 5, averaging_options, &scales2));
  EXPECT_EQ(scales1[0], 0);
  EXPECT_EQ(scales2[5], 0);
  for (int i = 0; i < num_nodes; ++i) {
    // Linear convergence down to steps of 1e-9 of 0.03.
    EXPECT_NEAR(scales1[i] - scales1[5], scales2[i], 1e-8);
  }
}

TEST(ScaleAveraging, SingleNodeAndTwoNodes) {
  std::vector<double> log_scales;
  ASSERT_TRUE(AverageScales(1, {}, 0, {}, &log_scales));
  EXPECT_THAT(log_scales, ElementsAre(0));
  ASSERT_TRUE(AverageScales(2, {{0, 1, 0.5}}, 1, {}, &log_scales));
  EXPECT_THAT(log_scales, ElementsAre(-0.5, 0));
}

TEST(ScaleAveraging, DisconnectedGraphFailsAndChangesNothing) {
  std::vector<double> log_scales = {7};
  EXPECT_FALSE(AverageScales(3, {{0, 1, 0.5}}, 0, {}, &log_scales));
  EXPECT_THAT(log_scales, ElementsAre(7));
}

TEST(ScaleAveraging, ThrowsOnBrokenInput) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto average = [](const RelativeLogScale& ratio,
                          int fixed_node,
                          const GraphAveragingOptions& options) {
    std::vector<double> log_scales;
    return AverageScales(2, {ratio}, fixed_node, options, &log_scales);
  };
  EXPECT_TRUE(average({0, 1, 1}, 0, {}));
  EXPECT_THROW(average({0, 1, nan}, 0, {}), std::invalid_argument);
  EXPECT_THROW(average({0, 1, 1, 0}, 0, {}), std::invalid_argument);
  EXPECT_THROW(average({0, 2, 1}, 0, {}), std::invalid_argument);
  EXPECT_THROW(average({0, 1, 1}, -1, {}), std::invalid_argument);
  GraphAveragingOptions options;
  options.loss_scale = 0;
  EXPECT_THROW(average({0, 1, 1}, 0, options), std::invalid_argument);
}

TEST(ScaleAveraging, SameBitsTwice) {
  ProblemOptions options;
  options.noise_stddev = 0.1;
  options.outlier_ratio = 0.2;
  const Problem problem = CreateProblem(options);
  EXPECT_EQ(Average(problem), Average(problem));
}

}  // namespace
}  // namespace dgsfm
