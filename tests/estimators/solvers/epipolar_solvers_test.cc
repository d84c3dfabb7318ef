#include "estimators/solvers/epipolar.h"
#include "estimators/solvers/five_points.h"
#include "estimators/two_view/two_view_model.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Exact matches of random poses, points behind camera 2 included.
template <size_t N>
class ExactSamples {
 public:
  SampleLanes<N> Next() {
    SampleLanes<N> samples;
    for (int lane = 0; lane < kNumLanes; ++lane) {
      TwoViewModel& truth = truths_[lane];
      const Eigen::Vector3d axis(
          Uniform(-1, 1), Uniform(-1, 1), Uniform(-1, 1));
      truth.rotation = Eigen::AngleAxisd(Uniform(0, 1), axis.normalized())
                           .toRotationMatrix();
      truth.translation << Uniform(-2, 2), Uniform(-2, 2), Uniform(-2, 2);
      for (size_t k = 0; k < N; ++k) {
        const double z = Uniform(3, 10);
        const Eigen::Vector3d point1(z * Uniform(-1, 1), z * Uniform(-1, 1), z);
        samples.Set(
            k,
            lane,
            point1.hnormalized(),
            (truth.rotation * point1 + truth.translation).hnormalized());
      }
    }
    return samples;
  }

  // Distance between the truth and the nearest solution, both of unit norm.
  template <size_t kMaxCount>
  double Distance(int lane,
                  const EpipolarMatrices<kMaxCount>& solutions) const {
    const Eigen::Matrix3d E = truths_[lane].EssentialMatrix().normalized();
    double best = 1;
    for (int i = 0; i < solutions.count; ++i) {
      const Eigen::Matrix3d solution = solutions.values[i].normalized();
      best = std::min({best, (solution - E).norm(), (solution + E).norm()});
    }
    return best;
  }

 private:
  double Uniform(double min, double max) {
    return std::uniform_real_distribution<double>(min, max)(random_);
  }

  std::mt19937_64 random_{1};
  std::array<TwoViewModel, kNumLanes> truths_;
};

// Expects the truth in nearly all samples; some roots are beyond 100.
template <size_t N, class Solver>
void ExpectTruthFound(const Solver& solver) {
  constexpr int kNumBatches = 1250;
  ExactSamples<N> exact_samples;
  std::vector<double> distances;
  for (int batch = 0; batch < kNumBatches; ++batch) {
    const SampleLanes<N> samples = exact_samples.Next();
    const auto solutions = solver(samples);
    for (int lane = 0; lane < kNumLanes; ++lane) {
      distances.push_back(exact_samples.Distance(lane, solutions[lane]));
    }
  }
  std::sort(distances.begin(), distances.end());
  EXPECT_LT(distances[distances.size() * 97 / 100], 1e-6);
  // Rounding, amplified by an elimination of size 10.
  EXPECT_LT(distances[distances.size() / 2], 1e-11);
}

TEST(FivePoints, FindsTruthOfExactProblems) {
  ExpectTruthFound<5>(SolveFivePoints);
}

TEST(SevenPoints, FindsTruthOfExactProblems) {
  ExpectTruthFound<7>(SolveSevenPoints);
}

// Lanes do not influence each other: a sample has the same solutions beside
// others.
TEST(FivePoints, LanesAreIndependent) {
  ExactSamples<5> exact_samples;
  const SampleLanes<5> samples = exact_samples.Next();
  const SampleLanes<5> others = exact_samples.Next();
  const auto expected = SolveFivePoints(samples);
  for (int lane = 0; lane < kNumLanes; ++lane) {
    SampleLanes<5> mixed = others;
    for (int k = 0; k < 5; ++k) {
      mixed.x1[k][lane] = samples.x1[k][lane];
      mixed.y1[k][lane] = samples.y1[k][lane];
      mixed.x2[k][lane] = samples.x2[k][lane];
      mixed.y2[k][lane] = samples.y2[k][lane];
    }
    const EssentialMatrices solutions = SolveFivePoints(mixed)[lane];
    ASSERT_EQ(solutions.count, expected[lane].count);
    for (int i = 0; i < solutions.count; ++i) {
      EXPECT_EQ(solutions.values[i], expected[lane].values[i]);
    }
  }
}

template <size_t N, class Solver>
void ExpectFiniteSolutions(const Solver& solver) {
  // Points on a line, one point, points that are no numbers.
  SampleLanes<N> samples;
  for (size_t k = 0; k < N; ++k) {
    for (int lane = 0; lane < kNumLanes; ++lane) {
      const double i = static_cast<double>(k);
      const double factor = lane % 3 == 0   ? 1
                            : lane % 3 == 1 ? 0
                                            : std::nan("");
      const Eigen::Vector2d point(factor * i, 2 * factor * i);
      samples.Set(k, lane, point, point);
    }
  }
  for (const auto& solutions : solver(samples)) {
    for (int i = 0; i < solutions.count; ++i) {
      EXPECT_TRUE(solutions.values[i].allFinite());
    }
  }
}

TEST(FivePoints, DegenerateProblemsGiveFiniteSolutionsOrNone) {
  ExpectFiniteSolutions<5>(SolveFivePoints);
}

TEST(SevenPoints, DegenerateProblemsGiveFiniteSolutionsOrNone) {
  ExpectFiniteSolutions<7>(SolveSevenPoints);
}

}  // namespace
}  // namespace dgsfm
