// A loop over all cores whose results do not depend on their number: items are
// independent and write to their own place.

#pragma once

#include <cstddef>
#include <functional>

namespace dgsfm {

// Threads to use for an option value: itself if positive, else one per core.
int EffectiveNumThreads(int num_threads);

// Calls function(i) for i in [0, count), in this order on one thread, otherwise
// with items handed out in this order. The first exception is rethrown here
// after all threads have stopped; so is Cancelled (see cancellation.h).
void ParallelFor(size_t count,
                 int num_threads,
                 const std::function<void(size_t)>& function);

}  // namespace dgsfm
