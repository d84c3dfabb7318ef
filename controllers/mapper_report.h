// report.json of depth_global_mapper: what each stage did, why pairs left and
// why images are missing.

#pragma once

#include "colmap_ext/local_frame.h"
#include "sfm/global_mapping.h"
#include "sfm/verification/relative_depth.h"

#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace dgsfm {

// Files of a run, beside the models.
constexpr char kReportFile[] = "report.json";
constexpr char kProjectFile[] = "project.ini";

// The entries of stages, in their order.
nlohmann::ordered_json StageEntries(const std::vector<StageReport>& stages);

// Maps of unknown scale and shift: the fits by pairs, which the mapping used,
// and by the points of the models.
struct RelativeDepthReport {
  RelativeDepthFits by_pairs;
  RelativeDepthFits by_models;
};

// `frame` is that of positions of images, if they are geodetic. Throws
// std::runtime_error if the file cannot be written.
void WriteMapperReport(const std::string& path,
                       const Scene& scene,
                       const PairGeometries& pairs,
                       const std::optional<LocalFrame>& frame,
                       const DepthGlobalMapperResult& result,
                       const RelativeDepthReport& relative_depths = {});

}  // namespace dgsfm
