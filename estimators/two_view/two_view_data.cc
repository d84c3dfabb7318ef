#include "estimators/two_view/two_view_data.h"

namespace dgsfm {
namespace {

template <typename T>
std::vector<T> Select(const std::vector<T>& values,
                      const std::vector<int>& indices) {
  std::vector<T> selected;
  if (values.empty()) return selected;
  selected.reserve(indices.size());
  for (const int i : indices) selected.push_back(values[i]);
  return selected;
}

}  // namespace

TwoViewData TwoViewData::Subset(const std::vector<int>& indices) const {
  return {Select(points1, indices),
          Select(points2, indices),
          Select(depths1, indices),
          Select(depths2, indices),
          Select(covariances1, indices),
          Select(covariances2, indices)};
}

}  // namespace dgsfm
