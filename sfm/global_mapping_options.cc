#include "sfm/global_mapping_options.h"

#include "estimators/option_check.h"

namespace dgsfm {

bool DepthGlobalMapperOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Valid(view_graph)
      .Valid(averaging)
      .Valid(tracks)
      .Valid(refinement)
      .Valid(georeferencing)
      .AtLeast("min_model_size", min_model_size, 2)
      .AreKept();
}

}  // namespace dgsfm
