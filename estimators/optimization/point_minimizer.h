// Levenberg-Marquardt over cameras and points with the points eliminated.

#pragma once

#include "colmap_ext/progress.h"
#include "estimators/optimization/column_order.h"
#include "estimators/optimization/implicit_reduction.h"
#include "estimators/optimization/point_elimination.h"
#include "estimators/optimization/reduced_system.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace dgsfm {

struct PointMinimizerOptions {
  // Label of the progress that is shown; empty = none is shown.
  std::string label;
  int max_num_iterations = 100;
  // Relative decrease of the cost by one step at which it has converged [1], or
  // a tenth of that by the cameras: what is left then are single points.
  double function_tolerance = 1e-6;
  // Whether points that lag behind the cameras are refined by themselves
  // between steps: not where cameras have far to go, whom this would hold back.
  bool refine_points = true;
  // Damping of the first step, relative to the diagonal of the normal equations
  // [1]. It holds back what hardly changes the cost.
  double initial_damping = 1e-4;
  // Smallest ratio of the damping to that of the step before [1].
  double min_damping_ratio = 1.0 / 3;
  int num_threads = 1;
  // Entries of the factor of the reduced system, of 8 bytes each, above which
  // steps come from conjugate gradients.
  double max_num_factor_entries = 2e8;
  // Floating-point operations that form the factor, about a second of them,
  // above which conjugate gradients are tried first.
  double max_num_factor_operations = 3e10;
};

struct PointMinimizerSummary {
  // Whether the cost could be evaluated at the start; the end is never worse.
  bool success = false;
  bool converged = false;
  int num_iterations = 0;
  double initial_cost = 0;
  double final_cost = 0;
};

// A sum of robust costs of observations, one camera and one point each, and of
// further terms of the cameras' columns alone.
template <int kResidual, int kCamera>
class PointProblem {
 public:
  using Elimination = PointElimination<kResidual, kCamera>;
  using Row = typename Elimination::Row;
  using CameraColumns = typename Elimination::CameraColumns;
  using Triplets = std::vector<Eigen::Triplet<double>>;

  virtual ~PointProblem() = default;

  // Half the robust squared residual, or infinity where there is none.
  virtual double Cost(int observation) const = 0;
  // The residual with derivatives, scaled so that J^T r is the gradient of the
  // cost. Called where the cost is finite.
  virtual void Linearize(int observation, Row* row) const = 0;
  // Further terms; the pattern of their lower triangle stays.
  virtual double TermsCost() const { return 0; }
  virtual void LinearizeTerms(Triplets* /*hessian*/,
                              Eigen::VectorXd* /*gradient*/) const {}
  // Moves all parameters, keeping where they were for Undo.
  virtual void Step(const Eigen::VectorXd& column_steps,
                    const std::vector<Eigen::Vector3d>& point_steps) = 0;
  virtual void Undo() = 0;
  // May be moved by itself.
  virtual Eigen::Vector3d& Point(int point) = 0;

  ObservationIndex observation_index;
  std::vector<CameraColumns> camera_columns;
  int num_columns = 0;
};

namespace internal {

template <int kResidual, int kCamera>
class PointMinimizer {
 public:
  using Problem = PointProblem<kResidual, kCamera>;
  using Row = typename Problem::Row;

  PointMinimizer(const PointMinimizerOptions& options, Problem* problem)
      : options_(options),
        problem_(problem),
        elimination_(
            problem->observation_index,
            problem->camera_columns,
            [problem](int k, Row* row) { problem->Linearize(k, row); },
            options.num_threads) {
    order_ = Order();
    if (order_.num_operations <= options_.max_num_factor_operations &&
        IsFactorSmall()) {
      ReduceDirectly();
      return;
    }
    elimination_.ReleaseBlocks();
    implicit_.emplace(order_.groups, &elimination_);
  }

  PointMinimizerSummary Run() {
    PointMinimizerSummary summary;
    double cost = Cost();
    summary.initial_cost = summary.final_cost = cost;
    summary.success = std::isfinite(cost);
    if (!summary.success) return summary;
    IterationProgress progress(options_.label,
                               options_.function_tolerance,
                               size_t(options_.max_num_iterations));
    cost -= LinearizeAndRefinePoints(cost);
    summary.final_cost = cost;
    while (summary.num_iterations < options_.max_num_iterations &&
           damping_ < kMaxDamping) {
      ++summary.num_iterations;
      const double decrease = TryStep();
      if (!(decrease > 0)) {
        progress.Step();
        Reject();
        continue;
      }
      const double new_cost = Cost();
      const double gain = (cost - new_cost) / decrease;
      if (!(gain > kMinGain)) {
        problem_->Undo();
        // Not larger than rounding.
        summary.converged = decrease < kRoundingShare * cost;
        if (summary.converged) break;
        progress.Step();
        Reject();
        continue;
      }
      damping_ *=
          std::max(options_.min_damping_ratio, 1 - std::pow(2 * gain - 1, 3));
      growth_ = 2;
      const double last_cost = cost;
      cost = new_cost - LinearizeAndRefinePoints(new_cost);
      summary.final_cost = cost;
      const double max_decrease = options_.function_tolerance * last_cost;
      summary.converged = last_cost - cost <= max_decrease ||
                          column_decrease_ <= kColumnShare * max_decrease;
      if (summary.converged) break;
      progress.Step((last_cost - cost) / last_cost);
    }
    return summary;
  }

 private:
  static constexpr double kPointDamping = 1e-4;
  static constexpr double kMaxDamping = 1e16;
  static constexpr double kMinGain = 1e-3;
  static constexpr double kRoundingShare = 1e-12;
  static constexpr int kChunkSize = 4096;
  // Share of the decrease at which all has converged that one point must
  // promise to be refined by itself.
  static constexpr double kPointShare = 0.01;
  static constexpr int kMaxNumPointIterations = 10;
  // Share of the decrease at which all has converged that the columns must
  // promise to go on. Points that robust losses hold back creep for long.
  static constexpr double kColumnShare = 0.1;
  // Operations of a factor that take as long as one iteration of conjugate
  // gradients for one observation.
  static constexpr double kNumOperationsPerObservation = 300;
  static constexpr int kMaxNumConjugateGradientIterations = 500;

  ColumnOrder Order() {
    std::vector<int> columns;
    for (const auto& of_camera : problem_->camera_columns) {
      columns.insert(columns.end(), of_camera.begin(), of_camera.end());
    }
    return OrderColumns(
        elimination_.Blocks(), columns, kCamera, problem_->num_columns);
  }

  bool IsFactorSmall() const {
    return order_.num_factor_entries <= options_.max_num_factor_entries;
  }

  void ReduceDirectly() {
    implicit_.reset();
    system_.emplace(
        problem_->num_columns,
        [this](const auto& couple) { AddCouplings(couple); },
        order_.columns);
  }

  // How many iterations take as long as forming the factor.
  int MaxNumIterations() const {
    if (!IsFactorSmall()) return kMaxNumConjugateGradientIterations;
    const double num_iterations =
        order_.num_operations /
        (kNumOperationsPerObservation *
         double(problem_->observation_index.cameras.size()));
    return int(
        std::min<double>(kMaxNumConjugateGradientIterations, num_iterations));
  }

  void AddCouplings(const ReducedSystem::Coupling& couple) {
    elimination_.ForEachCoupling(couple);
    terms_.clear();
    terms_gradient_.setZero(problem_->num_columns);
    problem_->LinearizeTerms(&terms_, &terms_gradient_);
    for (const auto& term : terms_) couple(term.col(), term.row());
  }

  double Cost() const {
    const size_t count = problem_->observation_index.cameras.size();
    std::vector<double> sums((count + kChunkSize - 1) / kChunkSize, 0);
    ParallelFor(sums.size(), options_.num_threads, [&](size_t chunk) {
      const size_t end = std::min(count, (chunk + 1) * kChunkSize);
      for (size_t k = chunk * kChunkSize; k < end; ++k) {
        sums[chunk] += problem_->Cost(int(k));
      }
    });
    double cost = problem_->TermsCost();
    for (const double sum : sums) cost += sum;
    return cost;
  }

  // A few points, wrong ones above all, take many more steps than the cameras.
  // Those that promise a lower cost by themselves go on at once, with the
  // cameras held. Returns the decrease of the cost.
  double LinearizeAndRefinePoints(double cost) {
    const double min_decrease =
        kPointShare * options_.function_tolerance * cost;
    std::vector<double> decreases(problem_->observation_index.num_points, 0);
    diagonal_.setZero(problem_->num_columns);
    gradient_.setZero(problem_->num_columns);
    elimination_.Accumulate(
        [&](int point, Row* rows) {
          if (!options_.refine_points) return;
          decreases[point] = RefinePoint(point, min_decrease, rows);
        },
        &diagonal_,
        &gradient_);
    terms_.clear();
    terms_gradient_.setZero(problem_->num_columns);
    problem_->LinearizeTerms(&terms_, &terms_gradient_);
    gradient_ += terms_gradient_;
    for (const auto& term : terms_) {
      if (term.row() == term.col()) diagonal_(term.row()) += term.value();
    }
    return std::accumulate(decreases.begin(), decreases.end(), 0.0);
  }

  double RefinePoint(int point, double min_decrease, Row* rows) {
    double total = 0;
    double cost = -1;
    double damping = kPointDamping;
    for (int i = 0; i < kMaxNumPointIterations; ++i) {
      const auto [hessian, gradient] =
          elimination_.NormalEquations(point, rows);
      Eigen::Matrix3d damped = hessian;
      damped.diagonal() +=
          damping * Problem::Elimination::Damped(hessian.diagonal());
      const Eigen::Vector3d step = -damped.llt().solve(gradient);
      if (!(-0.5 * gradient.dot(step) > min_decrease)) break;
      if (cost < 0) cost = CostOfPoint(point);
      const Eigen::Vector3d start = problem_->Point(point);
      problem_->Point(point) += step;
      const double new_cost = CostOfPoint(point);
      if (!(new_cost < cost)) {
        problem_->Point(point) = start;
        damping *= 10;
        continue;
      }
      total += cost - new_cost;
      cost = new_cost;
      damping /= 10;
      for (int k = elimination_.PointBegin(point);
           k < elimination_.PointEnd(point);
           ++k) {
        problem_->Linearize(k, &rows[k - elimination_.PointBegin(point)]);
      }
    }
    return total;
  }

  double CostOfPoint(int point) const {
    double cost = 0;
    for (int k = elimination_.PointBegin(point);
         k < elimination_.PointEnd(point);
         ++k) {
      cost += problem_->Cost(k);
    }
    return cost;
  }

  // Returns the decrease of the cost that the linearised problem promises, 0 if
  // there is no step.
  double TryStep() {
    const Eigen::VectorXd damped =
        damping_ *
        PointProblem<kResidual, kCamera>::Elimination::Damped(diagonal_.array())
            .matrix();
    Eigen::VectorXd rhs;
    if (!(system_ ? SolveDirectly(damped, &rhs)
                  : SolveIteratively(damped, &rhs))) {
      return 0;
    }
    column_decrease_ = ColumnDecrease(damped, rhs);
    elimination_.Substitute(column_steps_, &point_steps_);
    const double decrease =
        0.5 *
            column_steps_.dot(damped.cwiseProduct(column_steps_) - gradient_) +
        elimination_.PointDecrease(damping_, point_steps_);
    if (decrease > 0) problem_->Step(column_steps_, point_steps_);
    return decrease;
  }

  // The decrease that the reduced system promises along the steps of the
  // columns, however far they are held back by damping.
  double ColumnDecrease(const Eigen::VectorXd& damped,
                        const Eigen::VectorXd& rhs) const {
    const double slope = rhs.dot(column_steps_);
    const double curvature =
        slope - column_steps_.dot(damped.cwiseProduct(column_steps_));
    return curvature > 0 ? 0.5 * slope * slope / curvature
                         : std::numeric_limits<double>::infinity();
  }

  // Both set the right side and the steps of the columns, whose diagonal grows
  // by `damped`.
  bool SolveDirectly(const Eigen::VectorXd& damped, Eigen::VectorXd* rhs) {
    system_->SetZero();
    *rhs = -terms_gradient_;
    elimination_.Eliminate(damping_, &*system_, rhs);
    double* values = system_->Values();
    for (const auto& term : terms_) {
      values[system_->EntryOf(term.row(), term.col())] += term.value();
    }
    for (int i = 0; i < problem_->num_columns; ++i) {
      values[system_->EntryOf(i, i)] += damped(i);
    }
    return system_->Solve(*rhs, &column_steps_);
  }

  // Scenes in which most images share points take few iterations, long chains
  // of images many: these are factorised from the first step that takes too
  // long.
  bool SolveIteratively(const Eigen::VectorXd& damped, Eigen::VectorXd* rhs) {
    *rhs = -terms_gradient_;
    implicit_->Form(damping_, rhs);
    if (implicit_->Solve(
            MaxNumIterations(), damped, terms_, *rhs, &column_steps_) ||
        !IsFactorSmall()) {
      return column_steps_.allFinite();
    }
    ReduceDirectly();
    return SolveDirectly(damped, rhs);
  }

  void Reject() {
    damping_ *= growth_;
    growth_ *= 2;
  }

  const PointMinimizerOptions options_;
  Problem* problem_;
  PointElimination<kResidual, kCamera> elimination_;
  typename Problem::Triplets terms_;
  Eigen::VectorXd terms_gradient_;
  ColumnOrder order_;
  // One of them.
  std::optional<ReducedSystem> system_;
  std::optional<ImplicitReduction<kResidual, kCamera>> implicit_;
  double damping_ = options_.initial_damping;
  double growth_ = 2;
  Eigen::VectorXd diagonal_;
  Eigen::VectorXd gradient_;
  Eigen::VectorXd column_steps_;
  double column_decrease_ = 0;
  std::vector<Eigen::Vector3d> point_steps_;
};

}  // namespace internal

// Minimises the sum of the costs. Steps are taken where they decrease the cost
// at least by a thousandth of what the linearised problem promises; the
// damping, relative to the diagonal of J^T J, follows their ratio (Nielsen).
// Between steps, points far from their minimum given the cameras go there.
// The same for any number of threads.
template <int kResidual, int kCamera>
PointMinimizerSummary MinimizeWithPoints(
    const PointMinimizerOptions& options,
    PointProblem<kResidual, kCamera>* problem) {
  return internal::PointMinimizer<kResidual, kCamera>(options, problem).Run();
}

}  // namespace dgsfm
