#pragma once

#include <vector>

namespace dgsfm {

// Median of the values; the mean of the middle two for an even number. Throws
// std::invalid_argument if there are none.
double Median(std::vector<double> values);

}  // namespace dgsfm
