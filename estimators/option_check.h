// One line per bound in the IsValid functions of option structs.

#pragma once

#include <sstream>
#include <string>

namespace dgsfm {

// Returns `valid`; if it does not hold, *error reads "<requirement>, but is
// <value>", e.g. "loss_scale must be > 0, but is -1". Conditions are written
// so that NaN fails them.
inline bool CheckOption(bool valid,
                        const char* requirement,
                        double value,
                        std::string* error) {
  if (!valid) {
    std::ostringstream message;
    message << requirement << ", but is " << value;
    *error = message.str();
  }
  return valid;
}

}  // namespace dgsfm
