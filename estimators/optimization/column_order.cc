#include "estimators/optimization/column_order.h"

#include "estimators/optimization/reduced_system.h"

#include <algorithm>
#include <map>
#include <utility>

namespace dgsfm {

namespace {

ColumnGroups GroupColumns(const std::vector<int>& columns,
                          int size,
                          int num_columns) {
  std::vector<std::vector<int>> cameras_of_column(num_columns);
  for (size_t i = 0; i < columns.size(); ++i) {
    if (columns[i] < 0) continue;
    std::vector<int>& cameras = cameras_of_column[columns[i]];
    const int camera = int(i) / size;
    if (cameras.empty() || cameras.back() != camera) cameras.push_back(camera);
  }
  ColumnGroups groups;
  groups.groups_of_camera.resize(columns.size() / size);
  std::map<std::vector<int>, int> indices;
  for (int column = 0; column < num_columns; ++column) {
    const auto [it, is_new] = indices.emplace(
        std::move(cameras_of_column[column]), int(groups.columns.size()));
    if (is_new) {
      groups.columns.emplace_back();
      for (const int camera : it->first) {
        groups.groups_of_camera[camera].push_back(it->second);
      }
    }
    groups.columns[it->second].push_back(column);
    groups.group_of_column.push_back(it->second);
  }
  return groups;
}

}  // namespace

ColumnOrder OrderColumns(const ObservationBlocks& blocks,
                         const std::vector<int>& columns,
                         int size,
                         int num_columns) {
  ColumnOrder order;
  if (num_columns == 0) return order;
  order.groups = GroupColumns(columns, size, num_columns);
  const ColumnGroups& groups = order.groups;
  const int num_groups = int(groups.columns.size());
  const auto pattern = [&](const ReducedSystem::Coupling& couple) {
    for (size_t camera = 0; camera < groups.groups_of_camera.size(); ++camera) {
      for (size_t b = blocks.BlockBegin(int(camera));
           b < blocks.BlockEnd(int(camera));
           ++b) {
        for (const int group1 : groups.groups_of_camera[camera]) {
          for (const int group2 :
               groups.groups_of_camera[blocks.OtherCamera(b)]) {
            couple(group1, group2);
          }
        }
      }
    }
  };
  const ReducedSystem::FactorAnalysis factor =
      ReducedSystem::AnalyzeFactor(num_groups, pattern);
  for (const int group : factor.order) {
    order.columns.insert(order.columns.end(),
                         groups.columns[group].begin(),
                         groups.columns[group].end());
  }
  const double group_size = double(num_columns) / num_groups;
  order.num_factor_entries = factor.num_entries * group_size * group_size;
  order.num_operations =
      factor.num_operations * group_size * group_size * group_size;
  return order;
}

}  // namespace dgsfm
