#include "sfm/mapping_context.h"

#include <algorithm>

#include <glog/logging.h>

namespace dgsfm {

size_t MinModelSize(const MappingContext& context) {
  return std::min(size_t(context.options.min_model_size),
                  std::max<size_t>(context.scene.images.size(), 2));
}

void MappingLog::Warn(const std::string& warning) {
  LOG(WARNING) << warning;
  warnings.push_back(warning);
}

}  // namespace dgsfm
