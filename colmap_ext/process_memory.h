#pragma once

namespace dgsfm {

// Largest resident memory of this process so far [MB]; 0 where the system does
// not tell.
double PeakMemoryMb();

}  // namespace dgsfm
