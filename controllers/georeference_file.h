// What report.json and georeference.json have of the frame of the models.

#pragma once

#include "colmap_ext/local_frame.h"
#include "colmap_ext/scene.h"
#include "sfm/georeferencing/model_alignment.h"

#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace dgsfm {

// File of a run, beside the models.
constexpr char kGeoreferenceFile[] = "georeference.json";

// Entry of a model in the report.
nlohmann::ordered_json GeoreferenceEntry(const Scene& scene,
                                         const ModelGeoreference& georeference);

// Entry of the frame in the report.
nlohmann::ordered_json FrameEntry(const LocalFrame& frame);

// Writes origin, PROJ pipeline, WKT and the matrix to earth-centred coordinates
// of the frame, and which models are in it.
void WriteGeoreference(const std::string& path,
                       const LocalFrame& frame,
                       const std::vector<ModelGeoreference>& georeferences);

}  // namespace dgsfm
