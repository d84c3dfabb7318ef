#include "estimators/averaging/rotation_averaging.h"

#include "tests/estimators/averaging_graph.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Products of some ten unit quaternions and as many angles: rounding only.
constexpr double kRoundingRad = 1e-10;

double DegToRad(double deg) { return deg * M_PI / 180; }

double AngleBetween(const Eigen::Quaterniond& rotation1,
                    const Eigen::Quaterniond& rotation2) {
  return rotation1.angularDistance(rotation2);
}

Eigen::Quaterniond RandomRotation(std::mt19937* random) {
  std::normal_distribution<double> normal;
  return Eigen::Quaterniond(
             normal(*random), normal(*random), normal(*random), normal(*random))
      .normalized();
}

// Random axis, normally distributed components of the angle-axis vector.
Eigen::Quaterniond RandomNoise(double stddev_deg, std::mt19937* random) {
  std::normal_distribution<double> normal(0, DegToRad(stddev_deg));
  const Eigen::Vector3d vector(
      normal(*random), normal(*random), normal(*random));
  return Eigen::Quaterniond(
      Eigen::AngleAxisd(vector.norm(), vector.normalized()));
}

struct ProblemOptions {
  int num_nodes = 30;
  double edge_probability = 0.5;
  double noise_deg = 0;
  // Share of edges with a random rotation.
  double outlier_ratio = 0;
  int seed = 1;
};

struct Problem {
  std::vector<Eigen::Quaterniond> truth;
  std::vector<RelativeRotation> relative_rotations;

  RelativeRotation TrueEdge(int node1, int node2) const {
    return {node1, node2, truth[node2] * truth[node1].conjugate()};
  }

  // Largest and mean angle to the truth in the gauge of node 0 [rad].
  std::pair<double, double> Errors(
      const std::vector<Eigen::Quaterniond>& rotations) const {
    double max_error = 0;
    double sum = 0;
    const Eigen::Quaterniond gauge = rotations[0].conjugate() * truth[0];
    for (size_t i = 0; i < truth.size(); ++i) {
      const double error = AngleBetween(rotations[i] * gauge, truth[i]);
      max_error = std::max(max_error, error);
      sum += error;
    }
    return {max_error, sum / truth.size()};
  }
};

// Connected by a chain of inliers, as image sequences are.
Problem CreateProblem(const ProblemOptions& options) {
  std::mt19937 random(options.seed);
  std::uniform_real_distribution<double> uniform;
  Problem problem;
  for (int i = 0; i < options.num_nodes; ++i) {
    problem.truth.push_back(RandomRotation(&random));
  }
  for (int i = 0; i < options.num_nodes; ++i) {
    for (int j = i + 1; j < options.num_nodes; ++j) {
      const bool in_chain = j == i + 1;
      if (!in_chain && uniform(random) > options.edge_probability) continue;
      const bool swapped = uniform(random) < 0.5;
      RelativeRotation edge =
          problem.TrueEdge(swapped ? j : i, swapped ? i : j);
      const Eigen::Quaterniond noise = RandomNoise(options.noise_deg, &random);
      const Eigen::Quaterniond wrong = RandomRotation(&random);
      const bool outlier = !in_chain && uniform(random) < options.outlier_ratio;
      edge.cam2_from_cam1 = outlier ? wrong : noise * edge.cam2_from_cam1;
      problem.relative_rotations.push_back(edge);
    }
  }
  std::shuffle(problem.relative_rotations.begin(),
               problem.relative_rotations.end(),
               random);
  return problem;
}

std::vector<Eigen::Quaterniond> Average(
    const Problem& problem,
    std::vector<Eigen::Quaterniond> rotations = {},
    const GraphAveragingOptions& options = GraphAveragingOptions()) {
  EXPECT_TRUE(AverageRotations(problem.truth.size(),
                               problem.relative_rotations,
                               0,
                               options,
                               &rotations));
  return rotations;
}

TEST(RotationAveraging, RecoversExactRotationsWithoutNoise) {
  const Problem problem = CreateProblem({});
  EXPECT_LT(problem.Errors(Average(problem)).first, kRoundingRad);
}

TEST(RotationAveraging, NoiseIsAveragedDown) {
  ProblemOptions options;
  options.noise_deg = 1;
  const Problem problem = CreateProblem(options);
  // Each of the three components has the standard deviation 1 deg / sqrt(15
  // edges per node); the gauge node's own error adds to it: mean length
  // 1.6 * sqrt(2) * 0.26 deg = 0.58 deg.
  EXPECT_LT(problem.Errors(Average(problem)).second, DegToRad(0.7));
}

TEST(RotationAveraging, ThirtyPercentOutliersLeaveInliersInPlace) {
  for (int seed = 0; seed < 20; ++seed) {
    ProblemOptions options;
    options.num_nodes = 50;
    options.outlier_ratio = 0.3;
    options.seed = seed;
    const Problem problem = CreateProblem(options);
    // Geman-McClure leaves an outlier of 10 deg, the nearest of some 180
    // random ones, a pull of 0.4 deg: 0.024 deg among the 17 inliers of a
    // node, and less at every other angle.
    EXPECT_LT(problem.Errors(Average(problem)).first, DegToRad(0.05))
        << "seed " << seed;
  }
}

// Largest and median angle to the truth [deg], the worlds aligned such that
// most of the rotations agree.
std::pair<double, double> AlignedErrorsDeg(
    const std::vector<Eigen::Quaterniond>& rotations,
    const std::vector<Eigen::Quaterniond>& truth) {
  std::vector<double> best = {180};
  for (size_t i = 0; i < truth.size(); i += 10) {
    const Eigen::Quaterniond gauge = rotations[i].conjugate() * truth[i];
    std::vector<double> errors;
    for (size_t j = 0; j < truth.size(); ++j) {
      errors.push_back(AngleBetween(rotations[j] * gauge, truth[j]) * 180 /
                       M_PI);
    }
    std::sort(errors.begin(), errors.end());
    if (errors[errors.size() / 2] < best[best.size() / 2]) best = errors;
  }
  return {best.back(), best[best.size() / 2]};
}

TEST(RotationAveraging, ThirtyPercentRandomFalseEdgesOfAnyLayout) {
  for (const GraphLayout layout :
       {GraphLayout::STREET, GraphLayout::CITY, GraphLayout::RANDOM}) {
    for (const bool false_neighbors : {false, true}) {
      AveragingGraphOptions options;
      options.layout = layout;
      options.num_nodes = 200;
      options.num_edges = 5000;
      options.rotation_noise_deg = 0.5;
      options.false_neighbors = false_neighbors;
      const AveragingGraph graph = CreateAveragingGraph(options);
      std::vector<Eigen::Quaterniond> rotations;
      ASSERT_TRUE(AverageRotations(
          options.num_nodes, graph.relative_rotations, 0, {}, &rotations));
      const auto [max_error, median_error] =
          AlignedErrorsDeg(rotations, graph.rotations);
      // 35 right edges per node leave 0.87 deg / sqrt(35) = 0.15 deg and the
      // alignment at one of them as much; along a street, which is six
      // neighbourhoods long, errors add up.
      EXPECT_LT(median_error, 0.5) << int(layout) << false_neighbors;
      EXPECT_LT(max_error, 1.5) << int(layout) << false_neighbors;
    }
  }
}

TEST(RotationAveraging, SparseStreetWithFalseNeighbors) {
  // Five right edges of seven per node. Without loops as a guide for the
  // start, one in seven nodes ends more than 10 deg off.
  for (int seed = 1; seed <= 10; ++seed) {
    AveragingGraphOptions options;
    options.layout = GraphLayout::STREET;
    options.num_nodes = 200;
    options.num_edges = 1000;
    options.rotation_noise_deg = 0;
    options.false_neighbors = true;
    options.seed = seed;
    const AveragingGraph graph = CreateAveragingGraph(options);
    std::vector<Eigen::Quaterniond> rotations;
    ASSERT_TRUE(AverageRotations(
        options.num_nodes, graph.relative_rotations, 0, {}, &rotations));
    // The pull of false edges, 0.4 deg each, adds up along the street.
    EXPECT_LT(AlignedErrorsDeg(rotations, graph.rotations).second, 0.5) << seed;
  }
}

TEST(RotationAveraging, OutliersWithNoiseCostLittleAccuracy) {
  ProblemOptions options;
  options.num_nodes = 50;
  options.noise_deg = 1;
  const double clean_error =
      CreateProblem(options).Errors(Average(CreateProblem(options))).second;
  options.outlier_ratio = 0.3;
  const Problem problem = CreateProblem(options);
  // 30 % fewer edges cost a factor 1.2, outliers near the inliers the rest.
  EXPECT_LT(problem.Errors(Average(problem)).second, 1.5 * clean_error);
}

TEST(RotationAveraging, FixedNodeKeepsItsStart) {
  ProblemOptions options;
  options.noise_deg = 1;
  const Problem problem = CreateProblem(options);
  std::vector<Eigen::Quaterniond> rotations = problem.truth;
  ASSERT_TRUE(AverageRotations(
      problem.truth.size(), problem.relative_rotations, 7, {}, &rotations));
  EXPECT_EQ(rotations[7].coeffs(), problem.truth[7].coeffs());
  rotations.clear();
  ASSERT_TRUE(AverageRotations(
      problem.truth.size(), problem.relative_rotations, 7, {}, &rotations));
  EXPECT_EQ(rotations[7].coeffs(), Eigen::Quaterniond::Identity().coeffs());
}

TEST(RotationAveraging, FixedNodeOnlyTurnsTheWorld) {
  ProblemOptions problem_options;
  problem_options.noise_deg = 1;
  problem_options.outlier_ratio = 0.2;
  const Problem problem = CreateProblem(problem_options);
  GraphAveragingOptions options;
  options.convergence_threshold = 1e-11;
  std::vector<Eigen::Quaterniond> rotations1 = problem.truth;
  std::vector<Eigen::Quaterniond> rotations2 = problem.truth;
  const int num_nodes = problem.truth.size();
  ASSERT_TRUE(AverageRotations(
      num_nodes, problem.relative_rotations, 0, options, &rotations1));
  ASSERT_TRUE(AverageRotations(
      num_nodes, problem.relative_rotations, 9, options, &rotations2));
  const Eigen::Quaterniond gauge = rotations1[0].conjugate() * rotations2[0];
  for (int i = 0; i < num_nodes; ++i) {
    // Both runs converge linearly down to steps of 1e-11 of 0.03 rad.
    EXPECT_LT(AngleBetween(rotations1[i] * gauge, rotations2[i]), 1e-9);
  }
}

TEST(RotationAveraging, StartFromTruthAndFromTreeAgree) {
  ProblemOptions problem_options;
  problem_options.noise_deg = 2;
  const Problem problem = CreateProblem(problem_options);
  GraphAveragingOptions options;
  options.convergence_threshold = 1e-11;
  const auto from_tree = Average(problem, {}, options);
  const auto from_truth = Average(problem, problem.truth, options);
  const Eigen::Quaterniond gauge = from_tree[0].conjugate() * from_truth[0];
  for (size_t i = 0; i < from_tree.size(); ++i) {
    EXPECT_LT(AngleBetween(from_tree[i] * gauge, from_truth[i]), 1e-9);
  }
}

TEST(RotationAveraging, PreciseEdgeWinsOverCoarseOne) {
  // Two parallel edges that disagree by 2 deg, with standard deviations of 1
  // and 3 deg: the weighted mean is 0.2 deg away from the first; the loss
  // lowers the second one's weight by 8 % at 0.6 standard deviations.
  const Eigen::Vector3d axis = Eigen::Vector3d(1, 2, 3).normalized();
  const Eigen::Quaterniond precise(Eigen::AngleAxisd(1.0, axis));
  const Eigen::Quaterniond coarse(Eigen::AngleAxisd(1.0 + DegToRad(2), axis));
  std::vector<Eigen::Quaterniond> rotations;
  ASSERT_TRUE(AverageRotations(
      2,
      {{0, 1, precise, DegToRad(1)}, {0, 1, coarse, DegToRad(3)}},
      0,
      {},
      &rotations));
  const double to_precise = AngleBetween(rotations[1], precise);
  EXPECT_GT(to_precise, DegToRad(0.18));
  EXPECT_LT(to_precise, DegToRad(0.2));
}

TEST(RotationAveraging, EdgesOfHalfATurn) {
  // A ring of ten half turns about changing axes, and chords.
  Problem problem;
  problem.truth.push_back(Eigen::Quaterniond::Identity());
  for (int i = 1; i < 10; ++i) {
    const Eigen::Vector3d axis =
        Eigen::Vector3d(std::cos(i), std::sin(i), 0.3 * i).normalized();
    problem.truth.push_back(Eigen::Quaterniond(Eigen::AngleAxisd(M_PI, axis)) *
                            problem.truth.back());
  }
  for (int i = 0; i < 10; ++i) {
    for (const int step : {1, 3}) {
      problem.relative_rotations.push_back(
          problem.TrueEdge(i, (i + step) % 10));
    }
  }
  EXPECT_LT(problem.Errors(Average(problem)).first, kRoundingRad);
}

TEST(RotationAveraging, StartHalfATurnAwayRecovers) {
  const Problem problem = CreateProblem({});
  std::vector<Eigen::Quaterniond> start = problem.truth;
  // One node turned right round: its residuals are half turns whose axes,
  // the same for all of its edges in the world frame, are free in sign.
  start[5] =
      start[5] * Eigen::Quaterniond(Eigen::AngleAxisd(
                     M_PI, Eigen::Vector3d(0.2, -0.5, 0.7).normalized()));
  EXPECT_LT(problem.Errors(Average(problem, start)).first, kRoundingRad);
}

TEST(RotationAveraging, SingleNodeAndTwoNodes) {
  std::vector<Eigen::Quaterniond> rotations;
  ASSERT_TRUE(AverageRotations(1, {}, 0, {}, &rotations));
  ASSERT_EQ(rotations.size(), 1);
  EXPECT_EQ(rotations[0].coeffs(), Eigen::Quaterniond::Identity().coeffs());

  const Eigen::Quaterniond quarter_turn(
      Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()));
  rotations.clear();
  ASSERT_TRUE(AverageRotations(2, {{0, 1, quarter_turn}}, 1, {}, &rotations));
  EXPECT_LT(AngleBetween(rotations[0], quarter_turn.conjugate()), kRoundingRad);
}

TEST(RotationAveraging, DisconnectedGraphFailsAndChangesNothing) {
  const Eigen::Quaterniond identity = Eigen::Quaterniond::Identity();
  std::mt19937 random(3);
  const Eigen::Quaterniond start = RandomRotation(&random);
  std::vector<Eigen::Quaterniond> rotations(4, start);
  EXPECT_FALSE(AverageRotations(
      4, {{0, 1, identity}, {2, 3, identity}}, 0, {}, &rotations));
  ASSERT_EQ(rotations.size(), 4);
  for (const auto& rotation : rotations) {
    EXPECT_EQ(rotation.coeffs(), start.coeffs());
  }
}

TEST(RotationAveraging, ThrowsOnBrokenInput) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Eigen::Quaterniond identity = Eigen::Quaterniond::Identity();
  const auto average = [](const RelativeRotation& edge,
                          int fixed_node,
                          const GraphAveragingOptions& options,
                          std::vector<Eigen::Quaterniond> rotations) {
    return AverageRotations(2, {edge}, fixed_node, options, &rotations);
  };
  const RelativeRotation good{0, 1, identity};
  EXPECT_TRUE(average(good, 0, {}, {}));
  EXPECT_THROW(average({0, 1, {nan, 0, 0, 0}}, 0, {}, {}),
               std::invalid_argument);
  EXPECT_THROW(average({0, 1, {0, 0, 0, 0}}, 0, {}, {}), std::invalid_argument);
  EXPECT_THROW(average({0, 1, identity, 0}, 0, {}, {}), std::invalid_argument);
  EXPECT_THROW(average({0, 1, identity, nan}, 0, {}, {}),
               std::invalid_argument);
  EXPECT_THROW(average({0, 0, identity}, 0, {}, {}), std::invalid_argument);
  EXPECT_THROW(average({0, 2, identity}, 0, {}, {}), std::invalid_argument);
  EXPECT_THROW(average(good, 2, {}, {}), std::invalid_argument);
  EXPECT_THROW(
      average(good, 0, {}, {identity, Eigen::Quaterniond(nan, 0, 0, 0)}),
      std::invalid_argument);
  GraphAveragingOptions options;
  options.loss_scale = -1;
  EXPECT_THROW(average(good, 0, options, {}), std::invalid_argument);
}

TEST(RotationAveraging, OptionsNameTheWrongField) {
  GraphAveragingOptions options;
  std::string error;
  EXPECT_TRUE(options.IsValid(&error));
  options.loss_scale = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "loss_scale must be > 0, but is nan");
}

TEST(RotationAveraging, SameBitsTwice) {
  ProblemOptions options;
  options.noise_deg = 2;
  options.outlier_ratio = 0.2;
  const Problem problem = CreateProblem(options);
  const auto rotations1 = Average(problem);
  const auto rotations2 = Average(problem);
  for (size_t i = 0; i < rotations1.size(); ++i) {
    EXPECT_EQ(rotations1[i].coeffs(), rotations2[i].coeffs());
  }
}

}  // namespace
}  // namespace dgsfm
