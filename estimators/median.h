#pragma once

#include <vector>

namespace dgsfm {

// Standard deviation of normally distributed values per median absolute
// deviation.
constexpr double kStddevPerMad = 1.4826;
// Values farther off than this many standard deviations are outliers: three in
// a thousand of a normal distribution.
constexpr double kMaxDeviation = 3;

// Width of Cauchy's function [standard deviations] with which it has 95 % of
// the efficiency of squares on normally distributed errors.
constexpr double kEfficientCauchyWidth = 2.385;

// Median of the values; the mean of the middle two for an even number. Throws
// std::invalid_argument if there are none.
double Median(std::vector<double> values);

// The value below which this share of the others lies [0 to 1]. Throws as
// Median does.
double Quantile(std::vector<double> values, double share);

// Standard deviation of normally distributed values by their median absolute
// deviation from a centre. Throws as Median does.
double RobustStddev(std::vector<double> values, double center);

}  // namespace dgsfm
