#pragma once

namespace dgsfm {

// Largest resident memory of this process so far [MB]; 0 where the system does
// not report it.
double PeakMemoryMb();

}  // namespace dgsfm
