#include "estimators/averaging/translation_averaging.h"

#include <limits>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct Problem {
  std::vector<Eigen::Vector3d> centers;
  std::vector<RelativeTranslation> translations;
  std::vector<bool> is_outlier;
};

// Cameras along a street, each seen by those up to four steps ahead. Outliers
// claim that two cameras a third of the street apart, or two thirds, stand
// within a metre. All of them pull the street together: with a share of 0.1,
// they outweigh the ten right translations across some steps; 0.05 leaves half.
Problem CreateProblem(int num_nodes,
                      double noise_ratio,
                      double outlier_ratio,
                      int seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const auto random_vector = [&]() {
    return Eigen::Vector3d(normal(engine), normal(engine), normal(engine));
  };
  Problem problem;
  for (int i = 0; i < num_nodes; ++i) {
    problem.centers.push_back(Eigen::Vector3d(2.0 * i, 0, 0) +
                              0.5 * random_vector());
  }
  for (int i = 0; i < num_nodes; ++i) {
    for (int j = i + 1; j < std::min(i + 5, num_nodes); ++j) {
      RelativeTranslation relative;
      relative.node1 = i;
      relative.node2 = j;
      relative.translation = problem.centers[j] - problem.centers[i];
      relative.stddev = 0.1 * relative.translation.norm();
      relative.translation +=
          noise_ratio * relative.translation.norm() * random_vector();
      problem.translations.push_back(relative);
      problem.is_outlier.push_back(false);
    }
  }
  const int num_outliers = int(outlier_ratio * problem.translations.size());
  for (int k = 0; k < num_outliers; ++k) {
    RelativeTranslation relative;
    relative.node1 = int(uniform(engine) * num_nodes);
    relative.node2 = (relative.node1 + num_nodes / 3) % num_nodes;
    relative.translation = 0.5 * random_vector();
    relative.stddev = 0.4;
    problem.translations.push_back(relative);
    problem.is_outlier.push_back(true);
  }
  for (int i = num_nodes - 1; i >= 0; --i) {
    problem.centers[i] -= problem.centers[0];
  }
  return problem;
}

double MaxError(const std::vector<Eigen::Vector3d>& centers,
                const Problem& problem) {
  double max_error = 0;
  for (size_t i = 0; i < centers.size(); ++i) {
    max_error = std::max(max_error, (centers[i] - problem.centers[i]).norm());
  }
  return max_error;
}

TEST(TranslationAveraging, ExactTranslationsGiveExactCenters) {
  const Problem problem = CreateProblem(30, 0, 0, 1);
  std::vector<Eigen::Vector3d> centers;
  ASSERT_TRUE(AverageTranslations(
      30, problem.translations, 0, GraphAveragingOptions(), &centers));
  // Rounding of a linear system, over 60 m.
  EXPECT_LT(MaxError(centers, problem), 1e-9);
}

TEST(TranslationAveraging, GaugeIsTheFixedNode) {
  const Problem problem = CreateProblem(10, 0.02, 0, 2);
  std::vector<Eigen::Vector3d> centers;
  ASSERT_TRUE(AverageTranslations(
      10, problem.translations, 7, GraphAveragingOptions(), &centers));
  EXPECT_EQ(centers[7], Eigen::Vector3d::Zero());
}

TEST(TranslationAveraging, OutliersHaveNoSayAndStandOut) {
  for (int seed = 0; seed < 10; ++seed) {
    const Problem problem = CreateProblem(40, 0, 0.05, seed);
    std::vector<Eigen::Vector3d> centers;
    ASSERT_TRUE(AverageTranslations(
        40, problem.translations, 0, GraphAveragingOptions(), &centers));
    // A redescending loss leaves outliers of 26 m, 65 standard deviations, a
    // weight of (3 / 65)^4, five in a million.
    EXPECT_LT(MaxError(centers, problem), 1e-2) << seed;
    const std::vector<double> errors =
        TranslationErrors(problem.translations, centers);
    for (size_t i = 0; i < errors.size(); ++i) {
      EXPECT_EQ(errors[i] > 5, problem.is_outlier[i]) << seed << ", " << i;
    }
  }
}

TEST(TranslationAveraging, NoiseAveragesOut) {
  const Problem problem = CreateProblem(40, 0.02, 0.05, 3);
  std::vector<Eigen::Vector3d> centers;
  ASSERT_TRUE(AverageTranslations(
      40, problem.translations, 0, GraphAveragingOptions(), &centers));
  // 39 steps of 2 m with 4 cm of noise each add up to 25 cm a component
  // without averaging; four ways a step halve that.
  EXPECT_LT(MaxError(centers, problem), 0.5);
}

TEST(TranslationAveraging, FailsWithoutConnection) {
  RelativeTranslation relative;
  relative.node2 = 1;
  std::vector<Eigen::Vector3d> centers = {Eigen::Vector3d::Ones()};
  EXPECT_FALSE(
      AverageTranslations(3, {relative}, 0, GraphAveragingOptions(), &centers));
  EXPECT_EQ(centers.size(), 1);
}

TEST(TranslationAveraging, RefusesWhatIsNotFinite) {
  RelativeTranslation relative;
  relative.node2 = 1;
  std::vector<Eigen::Vector3d> centers;
  relative.stddev = 0;
  EXPECT_THROW((void)AverageTranslations(
                   2, {relative}, 0, GraphAveragingOptions(), &centers),
               std::invalid_argument);
  relative.stddev = 1;
  relative.translation.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)AverageTranslations(
                   2, {relative}, 0, GraphAveragingOptions(), &centers),
               std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
