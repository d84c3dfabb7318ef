#include "sfm/georeferencing/georeferencing_options.h"

#include "estimators/option_check.h"

namespace dgsfm {

bool GeoreferencingOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Above("loss_scale", loss_scale, 0)
      .Above("max_log_scale_stddev", max_log_scale_stddev, 0)
      .Above("max_pair_distance_ratio", max_pair_distance_ratio, 1)
      .AreKept();
}

}  // namespace dgsfm
