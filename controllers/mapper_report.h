// report.json of depth_global_mapper: what each stage did, why pairs left and
// why images are missing.

#pragma once

#include "sfm/global_mapping.h"

#include <string>

namespace dgsfm {

// Throws std::runtime_error if the file cannot be written.
void WriteMapperReport(const std::string& path,
                       const Scene& scene,
                       const PairGeometries& pairs,
                       const DepthGlobalMapperResult& result);

}  // namespace dgsfm
