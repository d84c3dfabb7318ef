#pragma once

#include "colmap_ext/database/sqlite.h"

#include <string>
#include <vector>

namespace dgsfm {

// All values of all columns of the pair geometries.
inline std::vector<std::string> PairRows(const std::string& path) {
  const SqliteConnection connection(path, SqliteConnection::Mode::READ_ONLY);
  std::string values = "''";
  SqliteStatement columns(
      connection,
      "SELECT name FROM pragma_table_info('dgsfm_pair_geometries')");
  while (columns.Step()) values += "||','||quote(" + columns.Text(0) + ")";
  std::vector<std::string> rows;
  if (values.size() == 2) return rows;
  SqliteStatement select(
      connection,
      "SELECT " + values + " FROM dgsfm_pair_geometries ORDER BY pair_id");
  while (select.Step()) rows.push_back(select.Text(0));
  return rows;
}

}  // namespace dgsfm
