#include "estimators/median.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dgsfm {

double Median(std::vector<double> values) {
  DGSFM_CHECK(!values.empty());
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

double RobustStddev(std::vector<double> values, double center) {
  for (double& value : values) value = std::abs(value - center);
  return kStddevPerMad * Median(std::move(values));
}

}  // namespace dgsfm
