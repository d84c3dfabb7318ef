#pragma once

#include <vector>

namespace dgsfm {

// Median of the values; the mean of the middle two for an even number. Throws
// std::invalid_argument if there are none.
double Median(std::vector<double> values);

// Standard deviation of normally distributed values by their median absolute
// deviation from a centre: 1.4826 times it. Throws as Median does.
double RobustStddev(std::vector<double> values, double center);

}  // namespace dgsfm
