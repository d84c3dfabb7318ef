#include "estimators/averaging/gravity_refinement.h"

#include "estimators/median.h"
#include "tests/estimators/averaging_graph.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

using Rotations = std::vector<Eigen::Quaterniond>;

struct StreetOptions {
  double pair_noise_deg = 1;
  // All pairs are turned by this as well, as wrong distortion does.
  double bend_deg = 0;
  double false_ratio = 0;
  double gravity_noise_deg = 2;
  // Share of nodes whose gravity has a random direction.
  double wrong_ratio = 0;
  int num_edges = 500;
  unsigned seed = 1;
};

// A street of 100 nodes, its averaged rotations and its gravity. The world is
// upright: gravity is along -z in it.
struct Street {
  AveragingGraph graph;
  std::vector<NodeGravity> gravities;
  Rotations averaged;
};

Street CreateStreet(const StreetOptions& options) {
  AveragingGraphOptions graph_options;
  graph_options.layout = GraphLayout::STREET;
  graph_options.num_edges = options.num_edges;
  graph_options.rotation_noise_deg = options.pair_noise_deg;
  graph_options.false_ratio = options.false_ratio;
  graph_options.false_neighbors = true;
  graph_options.seed = options.seed;
  Street street;
  street.graph = CreateAveragingGraph(graph_options);
  const Rotations& truth = street.graph.rotations;
  for (RelativeRotation& relative : street.graph.relative_rotations) {
    const double angle_rad =
        options.bend_deg * M_PI / 180 * (relative.node2 - relative.node1);
    relative.cam2_from_cam1 =
        relative.cam2_from_cam1 * truth[relative.node1] *
        Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitX()) *
        truth[relative.node1].conjugate();
  }
  std::mt19937 random(options.seed + 100);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  for (size_t i = 0; i < truth.size(); ++i) {
    Eigen::Vector3d gravity = truth[i] * -Eigen::Vector3d::UnitZ();
    const bool is_wrong = uniform(random) < options.wrong_ratio;
    for (int k = 0; k < 3; ++k) {
      gravity(k) = (is_wrong ? 0 : gravity(k)) +
                   (is_wrong ? 1 : options.gravity_noise_deg * M_PI / 180) *
                       normal(random);
    }
    street.gravities.push_back({int(i), gravity.normalized()});
  }
  EXPECT_TRUE(AverageRotations(int(truth.size()),
                               street.graph.relative_rotations,
                               0,
                               {},
                               &street.averaged));
  return street;
}

Rotations Refined(const Street& street) {
  Rotations rotations = street.averaged;
  EXPECT_TRUE(RefineByGravity({},
                              {},
                              street.graph.relative_rotations,
                              street.gravities,
                              0,
                              &rotations));
  return rotations;
}

// Median error of the rotations between nodes that are this far apart [deg].
double MedianErrorDeg(const Street& street,
                      const Rotations& rotations,
                      size_t distance) {
  const Rotations& truth = street.graph.rotations;
  std::vector<double> errors;
  for (size_t i = 0; i + distance < truth.size(); ++i) {
    const Eigen::Quaterniond found =
        rotations[i + distance] * rotations[i].conjugate();
    errors.push_back(
        found.angularDistance(truth[i + distance] * truth[i].conjugate()) *
        180 / M_PI);
  }
  return Median(errors);
}

// The sum of these errors over ten streets, averaged and refined.
std::pair<double, double> SumsOfErrorsDeg(StreetOptions options,
                                          size_t distance) {
  std::pair<double, double> sums;
  for (options.seed = 1; options.seed <= 10; ++options.seed) {
    const Street street = CreateStreet(options);
    sums.first += MedianErrorDeg(street, street.averaged, distance);
    sums.second += MedianErrorDeg(street, Refined(street), distance);
  }
  return sums;
}

TEST(GravityRefinement, ExactDataStayExact) {
  StreetOptions options;
  options.pair_noise_deg = options.gravity_noise_deg = 0;
  const Street street = CreateStreet(options);
  // The averages converge to 1e-3 of a standard deviation of 1.7 deg.
  EXPECT_LT(MedianErrorDeg(street, Refined(street), 50), 2e-3);
}

TEST(GravityRefinement, HoldsTheVerticalOfAStreet) {
  // Five pairs of 1 deg a node, 55 times as stiff as one to the next: each of
  // three components drifts by 0.135 deg * sqrt(50) = 0.95 deg. Gravity holds
  // two of them to 0.5 deg, by 2 deg of some 30 nodes: 1.2 deg of 1.65 in all.
  const auto [averaged, refined] = SumsOfErrorsDeg({}, 50);
  EXPECT_LT(refined, 0.85 * averaged);
  // Neighbours differ by the noise of their own pairs.
  const auto [averaged_next, refined_next] = SumsOfErrorsDeg({}, 1);
  EXPECT_LT(refined_next, 1.01 * averaged_next);
}

// 0.1 degrees a node bend the street by 10 degrees in all.
TEST(GravityRefinement, StraightensABentStreet) {
  StreetOptions options;
  options.bend_deg = 0.1;
  const Street street = CreateStreet(options);
  EXPECT_GT(MedianErrorDeg(street, street.averaged, 50), 3);
  // Against the bend, 83000 / (2 deg)^2 of gravity, which grows with the cube
  // of the nodes, stand to 100 * 55 / (1 deg)^2 of pairs of one to five nodes:
  // a fifth of it is left, and the heading, which drifts.
  EXPECT_LT(MedianErrorDeg(street, Refined(street), 50), 2);
}

TEST(GravityRefinement, PrecisePairsCountMoreThanGravity) {
  StreetOptions options;
  options.pair_noise_deg = 0.05;
  options.gravity_noise_deg = 3;
  for (const size_t distance : {1, 10, 50}) {
    // The bend that gravity of 3 deg asks for, 0.01 deg a node, counts 9000 to
    // the 2 million of the pairs.
    const auto [averaged, refined] = SumsOfErrorsDeg(options, distance);
    EXPECT_LT(refined, 1.02 * averaged) << distance;
  }
}

TEST(GravityRefinement, WrongGravityAndFalsePairsDoNoHarm) {
  StreetOptions options;
  options.false_ratio = 0.2;
  options.wrong_ratio = 0.3;
  // Four fifths of the pairs and 70 % of the gravity still help.
  const auto [averaged, refined] = SumsOfErrorsDeg(options, 50);
  EXPECT_LT(refined, 0.95 * averaged);
  const auto [averaged_next, refined_next] = SumsOfErrorsDeg(options, 1);
  EXPECT_LT(refined_next, 1.01 * averaged_next);
}

// Without loops nothing shows the noise of pairs: it is what was given.
TEST(GravityRefinement, HoldsAChain) {
  StreetOptions options;
  options.num_edges = 99;
  const Street street = CreateStreet(options);
  EXPECT_LT(MedianErrorDeg(street, Refined(street), 50),
            MedianErrorDeg(street, street.averaged, 50));
}

TEST(GravityRefinement, LeavesRotationsWithoutACommonVerticalAlone) {
  StreetOptions options;
  options.wrong_ratio = 0.8;
  const Street street = CreateStreet(options);
  const auto refine = [&](const std::vector<NodeGravity>& gravities) {
    Rotations rotations = street.averaged;
    EXPECT_FALSE(RefineByGravity(
        {}, {}, street.graph.relative_rotations, gravities, 0, &rotations));
    for (size_t i = 0; i < rotations.size(); ++i) {
      EXPECT_EQ(rotations[i].coeffs(), street.averaged[i].coeffs());
    }
  };
  refine(street.gravities);
  refine({});
}

TEST(GravityRefinement, FixedNodeKeepsItsRotationAndRunsAgree) {
  const Street street = CreateStreet({});
  const Rotations first = Refined(street), second = Refined(street);
  EXPECT_EQ(first[0].coeffs(), street.averaged[0].coeffs());
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].coeffs(), second[i].coeffs());
  }
}

TEST(GravityRefinementOptions, NamesTheInvalidField) {
  GravityRefinementOptions options;
  options.stddev_deg = 0;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "gravity_stddev must be > 0, but is 0");
}

}  // namespace
}  // namespace dgsfm
