#include "colmap_ext/parallel.h"

#include "colmap_ext/cancellation.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace dgsfm {

int EffectiveNumThreads(int num_threads) {
  if (num_threads > 0) return num_threads;
  return std::max(1u, std::thread::hardware_concurrency());
}

void ParallelFor(size_t count,
                 int num_threads,
                 const std::function<void(size_t)>& function) {
  const size_t num_workers =
      std::min<size_t>(EffectiveNumThreads(num_threads), count);
  if (num_workers <= 1) {
    for (size_t i = 0; i < count; ++i) {
      ThrowIfCancelled();
      function(i);
    }
    return;
  }
  std::atomic<size_t> next(0);
  std::exception_ptr error;
  std::mutex error_mutex;
  const CancellationFlag* flag = CurrentCancellationFlag();
  const auto work = [&]() {
    const CancellationScope scope(flag);
    for (size_t i = next++; i < count; i = next++) {
      try {
        ThrowIfCancelled();
        function(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(error_mutex);
        if (!error) error = std::current_exception();
        next = count;
      }
    }
  };
  std::vector<std::thread> helpers;
  helpers.reserve(num_workers - 1);
  try {
    while (helpers.size() + 1 < num_workers) helpers.emplace_back(work);
  } catch (const std::exception&) {
    // The system has no more threads for us: those there are do the work.
  }
  work();
  for (std::thread& helper : helpers) helper.join();
  if (error) std::rethrow_exception(error);
}

}  // namespace dgsfm
