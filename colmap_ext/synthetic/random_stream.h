// Random numbers of the synthetic scenes: independent streams, so that adding
// a draw to one (e.g. image noise) leaves all others (e.g. geometry) as they
// were, and scenes of one seed can be compared in pairs.

#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

namespace dgsfm {

// A stream named by seed, purpose and up to two indices (e.g. image ids). The
// transforms are our own: those of the standard library differ between
// implementations.
class RandomStream {
 public:
  RandomStream(uint32_t seed,
               uint32_t purpose,
               uint32_t index1 = 0,
               uint32_t index2 = 0) {
    std::seed_seq sequence{seed, purpose, index1, index2};
    generator_.seed(sequence);
  }

  // In [0, 1).
  double Uniform() { return (generator_() >> 11) * 0x1.0p-53; }
  double Uniform(double min, double max) {
    return min + (max - min) * Uniform();
  }
  // In [0, size).
  size_t Index(size_t size) { return static_cast<size_t>(Uniform() * size); }

  // Zero mean, unit variance (Box-Muller, one value per call).
  double Normal() {
    const double radius = std::sqrt(-2 * std::log(1 - Uniform()));
    return radius * std::cos(2 * M_PI * Uniform());
  }

  template <typename T>
  void Shuffle(std::vector<T>* values) {
    for (size_t i = values->size(); i > 1; --i) {
      std::swap((*values)[i - 1], (*values)[Index(i)]);
    }
  }

 private:
  std::mt19937_64 generator_;
};

}  // namespace dgsfm
