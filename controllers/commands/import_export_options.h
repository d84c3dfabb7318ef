// Options of the importers and of the exporter, as commands and Python bind
// them. Those of the other commands are with their controllers.

#pragma once

#include "controllers/commands/command_options.h"
#include "controllers/dense_match_importer.h"
#include "controllers/depth_exporter.h"
#include "controllers/depth_importer.h"

namespace dgsfm {

// Bind all options; call before parsing.
void BindOptions(DepthImportOptions* options, CommandOptions* command_options);
void BindOptions(DenseMatchImportOptions* options,
                 CommandOptions* command_options);
void BindOptions(DepthExportOptions* options, CommandOptions* command_options);

}  // namespace dgsfm
