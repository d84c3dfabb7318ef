// Eight numbers at a time (sixteen of single precision), in vector registers of
// whatever width the processor has.
//
// Lanes are vectors of the compiler (GCC, Clang): operators work on all
// numbers, comparisons give a mask, and `mask ? a : b` selects. A function that
// is declared DGSFM_TARGET_CLONES is compiled for several processors, and the
// loader picks one; what it calls has to be inlined (DGSFM_INLINE). The order
// of sums depends on the number of lanes, which is the same for every
// processor; their rounding does not, since some fuse products and sums.

#pragma once

#include <cmath>
#include <cstdint>

// Lanes are passed between inlined functions only.
#pragma GCC diagnostic ignored "-Wpsabi"

// Sanitizers and Clang do not support functions that the loader picks. Flags
// like -march=native (here: AVX2) already choose a processor; GCC 12 crashes on
// clones for a lesser one.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__AVX2__) && !defined(__SANITIZE_ADDRESS__) &&            \
    !defined(__SANITIZE_THREAD__)
#define DGSFM_TARGET_CLONES \
  __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define DGSFM_TARGET_CLONES
#endif

#define DGSFM_INLINE inline __attribute__((always_inline))

namespace dgsfm {

constexpr int kNumLanes = 8;
constexpr int kNumFloatLanes = 16;

// Aligned explicitly: by default the alignment depends on the processor.
using Lanes = double __attribute__((vector_size(kNumLanes * sizeof(double)),
                                    aligned(kNumLanes * sizeof(double))));
using FloatLanes =
    float __attribute__((vector_size(kNumFloatLanes * sizeof(float)),
                         aligned(kNumFloatLanes * sizeof(float))));

DGSFM_INLINE Lanes Sqrt(const Lanes& values) {
  Lanes roots;
  for (int k = 0; k < kNumLanes; ++k) roots[k] = std::sqrt(values[k]);
  return roots;
}

DGSFM_INLINE Lanes Abs(const Lanes& values) {
  Lanes absolute;
  for (int k = 0; k < kNumLanes; ++k) absolute[k] = std::abs(values[k]);
  return absolute;
}

DGSFM_INLINE Lanes Max(const Lanes& a, const Lanes& b) { return a > b ? a : b; }

// Logarithms of positive normal numbers; errors are below two units in the last
// place, or 2e-16.
DGSFM_INLINE Lanes Log(const Lanes& values) {
  using Bits = int64_t
      __attribute__((vector_size(sizeof(Lanes)), aligned(sizeof(Lanes))));
  // values = m 2^e, m in [sqrt(1/2), sqrt(2)).
  constexpr int kNumMantissaBits = 52;
  constexpr int64_t kRootHalfBits = 0x3fe6a09e667f3bcd;
  const Bits bits = reinterpret_cast<Bits>(values);
  const Bits exponent = (bits - kRootHalfBits) >> kNumMantissaBits;
  const Bits mantissa_bits = bits - (exponent << kNumMantissaBits);
  const Lanes m = reinterpret_cast<Lanes>(mantissa_bits);
  // log m = 2 artanh f, f = (m - 1) / (m + 1): terms beyond f^21 / 21 are below
  // rounding.
  const Lanes f = (m - 1) / (m + 1);
  const Lanes sq_f = f * f;
  Lanes series = {};
  for (int order = 21; order >= 3; order -= 2) {
    series = (series + 1.0 / order) * sq_f;
  }
  return __builtin_convertvector(exponent, Lanes) * M_LN2 +
         2 * (f + f * series);
}

DGSFM_INLINE double Sum(const Lanes& values) {
  return ((values[0] + values[4]) + (values[2] + values[6])) +
         ((values[1] + values[5]) + (values[3] + values[7]));
}

DGSFM_INLINE float Sum(const FloatLanes& values) {
  float sums[kNumFloatLanes / 2];
  for (int k = 0; k < 8; ++k) sums[k] = values[k] + values[k + 8];
  for (int k = 0; k < 4; ++k) sums[k] += sums[k + 4];
  return (sums[0] + sums[2]) + (sums[1] + sums[3]);
}

}  // namespace dgsfm
