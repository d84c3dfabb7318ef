#include "estimators/median.h"

#include "colmap_ext/check.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dgsfm {

double Median(std::vector<double> values) {
  DGSFM_CHECK(!values.empty());
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

double Quantile(std::vector<double> values, double share) {
  DGSFM_CHECK(!values.empty());
  const auto place = values.begin() +
                     static_cast<ptrdiff_t>(share * double(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

double RobustStddev(std::vector<double> values, double center) {
  for (double& value : values) value = std::abs(value - center);
  return kStddevPerMad * Median(std::move(values));
}

}  // namespace dgsfm
