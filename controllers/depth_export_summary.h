// The file of alignments that depth_exporter writes beside the maps.

#pragma once

#include "controllers/depth_exporter.h"

#include <string>

namespace dgsfm {

constexpr char kAlignmentsFile[] = "alignment.json";

// Writes that file: scale, shift, residuals and number of points of each
// image. Throws std::runtime_error naming the file.
void WriteAlignments(const std::string& folder,
                     const DepthExportSummary& summary);

}  // namespace dgsfm
