// The closing words of depth_global_mapper: what was made, how good it looks,
// and what to look at.

#pragma once

#include "sfm/global_mapping.h"

#include <string>

namespace dgsfm {

// A paragraph of lines, each with a line break. `output_path` is the folder of
// the models. Numbers of the last report are time and memory of the whole.
std::string MapperSummary(const Scene& scene,
                          const DepthGlobalMapperResult& result,
                          const std::string& output_path);

}  // namespace dgsfm
