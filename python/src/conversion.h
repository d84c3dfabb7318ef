// Values between Python and the controllers.

#pragma once

#include "colmap_ext/depth/depth_map_io.h"
#include "controllers/commands/command_options.h"
#include "controllers/dense_match_importer.h"
#include "controllers/depth_exporter.h"
#include "controllers/depth_geometric_verifier.h"
#include "controllers/depth_importer.h"
#include "controllers/global_depth_mapper.h"

#include <map>
#include <string>

#include <nanobind/nanobind.h>

namespace dgsfm {

// Sets options from their names and values. Throws ValueError naming an option
// that does not exist or has another type.
void SetOptions(const nanobind::dict& values, CommandOptions* options);

// Name, default, help and choices of each option that is not required.
nanobind::list DescribeOptions(const CommandOptions& options);

// Readers of {name of array: array}; arrays are C-contiguous and have to
// outlive the reader, which needs no lock.
ArrayReader ReaderOf(const nanobind::dict& arrays);
// Those of {key: {name of array: array}}.
std::map<std::string, ArrayReader> ReadersOf(const nanobind::dict& groups);
// Depth of {image: path or {name of array: array}}.
std::map<std::string, DepthFile> DepthFilesOf(const nanobind::dict& depths);

nanobind::dict ToPython(const DepthImportSummary& summary);
nanobind::dict ToPython(const DenseMatchImportSummary& summary);
nanobind::dict ToPython(const VerificationSummary& summary);
nanobind::dict ToPython(const GlobalDepthMapperSummary& summary);
nanobind::dict ToPython(const DepthExportSummary& summary);

}  // namespace dgsfm
