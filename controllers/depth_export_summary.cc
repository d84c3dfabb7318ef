#include "controllers/depth_export_summary.h"

#include "colmap_ext/output_file.h"
#include "controllers/output_folder.h"
#include "estimators/median.h"

#include <filesystem>
#include <iomanip>
#include <sstream>
#include <vector>

#include <nlohmann/json.hpp>

namespace dgsfm {

std::string DepthExportSummary::ToText() const {
  std::ostringstream text;
  text << std::fixed << std::setprecision(2);
  std::vector<double> scale_residuals;
  std::vector<double> residuals;
  for (const Image& image : exported) {
    text << image.name << ": " << image.file;
    if (image.alignment) {
      text << ", " << image.alignment->num_points << " points, scale "
           << std::setprecision(4) << image.alignment->scale
           << std::setprecision(2) << ", median error "
           << 100 * image.alignment->scale_residual
           << " % after the best scale, " << 100 * image.alignment->residual
           << " % aligned";
      if (multi_view) {
        text << ", neighbours agree at " << 100 * image.agreeing_ratio
             << " % of the pixels, " << 100 * image.dropped_ratio
             << " % dropped";
      }
      scale_residuals.push_back(image.alignment->scale_residual);
      residuals.push_back(image.alignment->residual);
    }
    text << "\n";
  }
  const auto list = [&text](const std::string& what,
                            const std::vector<std::string>& names) {
    for (const std::string& name : names) text << what << ": " << name << "\n";
  };
  list("image without map", images_without_map);
  list("image that is not in the model", images_without_model);
  list("image with too few points", images_with_few_points);
  list("image without depth that png_scale can hold", images_out_of_range);
  text << "exported " << exported.size() << " depth maps";
  if (!residuals.empty()) {
    text << ", median error " << 100 * Median(scale_residuals)
         << " % after the best scale, " << 100 * Median(residuals)
         << " % aligned";
  }
  text << "\n";
  if (num_points > 0) text << "wrote " << num_points << " points\n";
  return text.str();
}

void WriteAlignments(const std::string& folder,
                     const DepthExportSummary& summary) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  for (const DepthExportSummary::Image& image : summary.exported) {
    json[image.name] = {{"scale", image.alignment->scale},
                        {"shift", image.alignment->shift},
                        {"has_field", !image.alignment->field.empty()},
                        {"num_points", image.alignment->num_points},
                        {"scale_residual", image.alignment->scale_residual},
                        {"residual", image.alignment->residual}};
    if (summary.multi_view) {
      json[image.name]["agreeing_ratio"] = image.agreeing_ratio;
      json[image.name]["dropped_ratio"] = image.dropped_ratio;
    }
  }
  WriteFile((std::filesystem::path(folder) / kAlignmentsFile).string(),
            JsonText(json, 2) + "\n");
}

}  // namespace dgsfm
