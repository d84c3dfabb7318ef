#include "estimators/averaging/graph_laplacian.h"

#include "tests/estimators/averaging_graph.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct Problem {
  std::vector<GraphEdge> edges;
  Eigen::VectorXd weights;
  Eigen::MatrixXd differences;
};

Problem CreateProblem(int num_nodes, int num_edges, int num_columns) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Problem problem;
  problem.edges =
      LayoutEdges(GraphLayout::RANDOM, num_nodes, num_edges, &random);
  problem.weights.resize(num_edges);
  problem.differences.resize(num_edges, num_columns);
  for (int e = 0; e < num_edges; ++e) {
    problem.weights(e) = std::exp(3 * uniform(random));
    for (int c = 0; c < num_columns; ++c) {
      problem.differences(e, c) = uniform(random);
    }
  }
  return problem;
}

// Norm of the gradient at the solution, relative to that at zero; that of the
// fixed node is the sum of the others.
double RelativeGradient(const Problem& problem,
                        const Eigen::MatrixXd& solution) {
  Eigen::MatrixXd gradient = 0 * solution;
  Eigen::MatrixXd start = 0 * solution;
  for (size_t e = 0; e < problem.edges.size(); ++e) {
    const auto [node1, node2] = problem.edges[e];
    const Eigen::RowVectorXd difference = problem.differences.row(e);
    const Eigen::RowVectorXd error =
        solution.row(node2) - solution.row(node1) - difference;
    gradient.row(node2) += problem.weights(e) * error;
    gradient.row(node1) -= problem.weights(e) * error;
    start.row(node2) -= problem.weights(e) * difference;
    start.row(node1) += problem.weights(e) * difference;
  }
  return gradient.norm() / start.norm();
}

TEST(GraphLaplacianSolver, FactorisationLeavesNoGradient) {
  for (const int num_columns : {1, 3}) {
    const Problem problem = CreateProblem(50, 200, num_columns);
    GraphLaplacianSolver solver(50, problem.edges, 7);
    Eigen::MatrixXd solution;
    ASSERT_TRUE(solver.Solve(problem.weights, problem.differences, &solution));
    EXPECT_EQ(solution.row(7).norm(), 0);
    // Rounding.
    EXPECT_LT(RelativeGradient(problem, solution), 1e-12);
  }
}

TEST(GraphLaplacianSolver, DenseGraphIsSolvedByConjugateGradients) {
  // Random edges fill the factors in: 1500^3 / 3 multiplications, a second.
  for (const int num_columns : {1, 3}) {
    const Problem problem = CreateProblem(1500, 30000, num_columns);
    GraphLaplacianSolver solver(1500, problem.edges, 7);
    Eigen::MatrixXd solution;
    ASSERT_TRUE(solver.Solve(problem.weights, problem.differences, &solution));
    EXPECT_EQ(solution.row(7).norm(), 0);
    // The solver's tolerance is 1e-4 in its own norm.
    const double gradient = RelativeGradient(problem, solution);
    EXPECT_LT(gradient, 1e-3);
    // Not a factorisation's rounding: this took the other way.
    EXPECT_GT(gradient, 1e-9);
  }
}

// Diagonals do not precondition a long street: some thousand iterations.
TEST(GraphLaplacianSolver, LargeGraphsOfAllLayoutsAreSolved) {
  for (const GraphLayout layout :
       {GraphLayout::STREET, GraphLayout::CITY, GraphLayout::RANDOM}) {
    AveragingGraphOptions options;
    options.layout = layout;
    options.num_nodes = 30000;
    options.num_edges = 150000;
    options.false_ratio = 0;
    const AveragingGraph graph = CreateAveragingGraph(options);
    Problem problem;
    problem.weights.resize(options.num_edges);
    problem.differences.resize(options.num_edges, 1);
    for (int e = 0; e < options.num_edges; ++e) {
      const RelativeLogScale& ratio = graph.ratios[e];
      problem.edges.emplace_back(ratio.node1, ratio.node2);
      problem.weights(e) = std::exp(e % 10);
      problem.differences(e, 0) =
          graph.log_scales[ratio.node2] - graph.log_scales[ratio.node1];
    }
    GraphLaplacianSolver solver(options.num_nodes, problem.edges, 7);
    Eigen::MatrixXd solution;
    ASSERT_TRUE(solver.Solve(problem.weights, problem.differences, &solution));
    double max_error = 0;
    for (int i = 0; i < options.num_nodes; ++i) {
      const double truth = graph.log_scales[i] - graph.log_scales[7];
      max_error = std::max(max_error, std::abs(solution(i, 0) - truth));
    }
    // The residual's tolerance, times some hundred for parts that few edges
    // hold; 0.03 was measured. Scales range over one.
    EXPECT_LT(max_error, 0.1);
  }
}

TEST(GraphLaplacianSolver, FailsWhereNothingHoldsANode) {
  Problem problem = CreateProblem(1500, 30000, 1);
  GraphLaplacianSolver solver(1501, problem.edges, 0);
  Eigen::MatrixXd solution = Eigen::MatrixXd::Ones(1, 1);
  EXPECT_FALSE(solver.Solve(problem.weights, problem.differences, &solution));
  EXPECT_EQ(solution.size(), 1);
}

TEST(GraphLaplacianSolver, SelfLoopsAddNothingAndParallelEdgesAddUp) {
  GraphLaplacianSolver solver(2, {{0, 1}, {1, 1}, {1, 0}}, 0);
  Eigen::MatrixXd solution;
  ASSERT_TRUE(solver.Solve(
      Eigen::Vector3d(3, 5, 1), Eigen::Vector3d(1, 7, -2), &solution));
  EXPECT_NEAR(solution(1, 0), (3 * 1 + 1 * 2) / 4.0, 1e-15);
}

TEST(GraphLaplacianSolver, ThrowsOnBrokenInput) {
  EXPECT_THROW(GraphLaplacianSolver(2, {{0, 1}}, 2), std::invalid_argument);
  EXPECT_THROW(GraphLaplacianSolver(2, {{0, 2}}, 0), std::invalid_argument);
  GraphLaplacianSolver solver(2, {{0, 1}}, 0);
  Eigen::MatrixXd solution;
  EXPECT_THROW(
      (void)solver.Solve(
          Eigen::VectorXd::Ones(2), Eigen::MatrixXd::Zero(1, 1), &solution),
      std::invalid_argument);
  EXPECT_THROW(
      (void)solver.Solve(
          Eigen::VectorXd::Ones(1), Eigen::MatrixXd::Zero(1, 2), &solution),
      std::invalid_argument);
}

}  // namespace
}  // namespace dgsfm
