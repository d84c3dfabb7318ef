// Products of small blocks by the widest instructions of the processor.

#pragma once

#include <Eigen/Core>

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>
#define DGSFM_HAS_AVX2_TARGET
#endif

namespace dgsfm {

// block += left right^T, or -= with kSign = -1, for which Eigen would call its
// kernels for large matrices. Sums may differ in the last bit from processor to
// processor, not from call to call.
template <int kSign, int kSize, int kRank>
class BlockProduct {
 public:
  using Factor = Eigen::Matrix<double, kSize, kRank>;
  using Block = Eigen::Matrix<double, kSize, kSize>;

  static void Add(const Factor& left, const Factor& right, Block* block) {
#ifdef DGSFM_HAS_AVX2_TARGET
    if constexpr (kSize % 2 == 0) {
      static const bool has_avx2 =
          __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
      if (has_avx2) {
        AddByAvx2(left.data(), right.data(), block->data());
        return;
      }
    }
#endif
    for (int j = 0; j < kSize; ++j) {
      Eigen::Matrix<double, kSize, 1> sum = left.col(0) * (kSign * right(j, 0));
      for (int r = 1; r < kRank; ++r) {
        sum += left.col(r) * (kSign * right(j, r));
      }
      block->col(j) += sum;
    }
  }

 private:
#ifdef DGSFM_HAS_AVX2_TARGET
  // Four rows at a time, and the last two.
  __attribute__((target("avx2,fma"))) static void AddByAvx2(const double* left,
                                                            const double* right,
                                                            double* block) {
    constexpr int kEnd = kSize / 4 * 4;
    for (int i = 0; i < kEnd; i += 4) {
      __m256d column[kRank];
      for (int r = 0; r < kRank; ++r) {
        column[r] = _mm256_loadu_pd(left + r * kSize + i);
      }
      for (int j = 0; j < kSize; ++j) {
        double* target = block + j * kSize + i;
        __m256d sum = _mm256_loadu_pd(target);
        for (int r = 0; r < kRank; ++r) {
          const __m256d factor = _mm256_set1_pd(right[r * kSize + j]);
          sum = kSign > 0 ? _mm256_fmadd_pd(column[r], factor, sum)
                          : _mm256_fnmadd_pd(column[r], factor, sum);
        }
        _mm256_storeu_pd(target, sum);
      }
    }
    if constexpr (kEnd < kSize) {
      __m128d column[kRank];
      for (int r = 0; r < kRank; ++r) {
        column[r] = _mm_loadu_pd(left + r * kSize + kEnd);
      }
      for (int j = 0; j < kSize; ++j) {
        double* target = block + j * kSize + kEnd;
        __m128d sum = _mm_loadu_pd(target);
        for (int r = 0; r < kRank; ++r) {
          const __m128d factor = _mm_set1_pd(right[r * kSize + j]);
          sum = kSign > 0 ? _mm_fmadd_pd(column[r], factor, sum)
                          : _mm_fnmadd_pd(column[r], factor, sum);
        }
        _mm_storeu_pd(target, sum);
      }
    }
  }
#endif
};

}  // namespace dgsfm
