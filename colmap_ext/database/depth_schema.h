// The tables of depth_database.md: their version and how they come about.

#pragma once

#include "colmap_ext/database/sqlite.h"

namespace dgsfm {

// Whether the tables are there, with the columns of depth that this program
// reads. Throws std::runtime_error with the remedy if they are of a version
// that has others.
bool HasDepthTables(const SqliteConnection& connection);

// Whether the table of pair geometries has the columns that this program reads.
// Throws as above.
bool HasPairTable(const SqliteConnection& connection);

// Creates the tables in an open transaction.
void CreateDepthTables(const SqliteConnection& connection);

// Creates the table of pair geometries alone, in any file.
void CreatePairTable(const SqliteConnection& connection);

// Creates the table of pair statuses in an open transaction where it is
// missing: only mappers write it.
void CreatePairStatusTable(const SqliteConnection& connection);

// The same for the table of images whose maps were turned back by EXIF.
void CreateDisplayedImageTable(const SqliteConnection& connection);

// Brings tables of an older version up to date: depth stays, pair geometries
// are dropped. Nothing happens without tables.
void UpdateDepthTables(const SqliteConnection& connection);

}  // namespace dgsfm
