// What the readers and writers of COLMAP databases share about COLMAP's tables.

#pragma once

#include "colmap_ext/database/sqlite.h"

#include <cstddef>
#include <cstdint>

namespace dgsfm {

// Throws std::runtime_error naming the file and the missing table unless the
// database has the tables that all COLMAP versions from 3.8 to 4.2 create.
void CheckIsColmapDatabase(const SqliteConnection& connection);

// Whether a blob of so many values can be a matrix of the announced size.
bool IsBlobSize(int64_t num_rows, int64_t num_cols, size_t num_values);

}  // namespace dgsfm
