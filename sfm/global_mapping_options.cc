#include "sfm/global_mapping_options.h"

#include "estimators/option_check.h"

namespace dgsfm {

bool DepthGlobalMapperOptions::IsValid(std::string* error) const {
  if (!view_graph.IsValid(error) || !averaging.IsValid(error) ||
      !tracks.IsValid(error) || !refinement.IsValid(error)) {
    return false;
  }
  return CheckOption(min_model_size >= 2,
                     "min_model_size must be >= 2",
                     min_model_size,
                     error);
}

}  // namespace dgsfm
