#pragma once

namespace dgsfm {

// Largest resident memory of this process so far [MB]; 0 where the system does
// not report it.
double PeakMemoryMb();

// Gives freed memory back to the system, where that is possible: that between
// small objects which stay would not be used for large ones.
void ReturnFreeMemory();

}  // namespace dgsfm
