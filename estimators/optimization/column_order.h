// In which order the columns of a reduced camera system are eliminated.

#pragma once

#include "estimators/optimization/observation_blocks.h"

#include <vector>

namespace dgsfm {

// Columns of the same cameras.
struct ColumnGroups {
  std::vector<std::vector<int>> columns;
  std::vector<int> group_of_column;
  // Groups that each camera has columns of.
  std::vector<std::vector<int>> groups_of_camera;
};

struct ColumnOrder {
  ColumnGroups groups;
  // All columns, the first to be eliminated first.
  std::vector<int> columns;
  // Entries of the factor, and floating-point operations that form it, about.
  double num_factor_entries = 0;
  double num_operations = 0;
};

// An order with a sparse factor. Columns of the same cameras stay together: it
// is found by the graph of such groups, which is much smaller than that of the
// columns. Camera i has `size` entries from columns[i * size] on, those below 0
// without a column.
ColumnOrder OrderColumns(const ObservationBlocks& blocks,
                         const std::vector<int>& columns,
                         int size,
                         int num_columns);

}  // namespace dgsfm
