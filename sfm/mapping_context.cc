#include "sfm/mapping_context.h"

#include <glog/logging.h>

namespace dgsfm {

void MappingLog::Warn(const std::string& warning) {
  LOG(WARNING) << warning;
  warnings.push_back(warning);
}

}  // namespace dgsfm
