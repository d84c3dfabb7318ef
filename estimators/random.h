// A private random stream: the same numbers on every platform, no global
// state, one per task.

#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace dgsfm {

// SplitMix64 [Steele 2014]. Streams of seeds that differ in a single bit are
// independent, so ids make good seeds.
class SplitMix64 {
 public:
  explicit SplitMix64(uint64_t seed) : state_(seed) {}

  uint64_t operator()() {
    state_ += 0x9e3779b97f4a7c15;
    uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
  }

  // In [0, bound), bound in [1, 2^32). Bias below bound / 2^32.
  int Below(int bound) {
    return static_cast<int>(((*this)() >> 32) * static_cast<uint64_t>(bound) >>
                            32);
  }

 private:
  uint64_t state_;
};

// Fisher-Yates.
template <typename T>
void Shuffle(SplitMix64* random, std::vector<T>* values) {
  for (int i = static_cast<int>(values->size()) - 1; i > 0; --i) {
    std::swap((*values)[i], (*values)[random->Below(i + 1)]);
  }
}

}  // namespace dgsfm
