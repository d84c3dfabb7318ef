// Validity of option structs.

#pragma once

#include <sstream>
#include <string>

namespace dgsfm {

// Checks the fields of an option struct one after the other; the first that is
// out of its bounds is named, e.g. "loss_scale must be > 0, but is -1". NaN is
// out of all bounds.
//
//   return OptionBounds(error)
//       .AtLeast("max_num_iterations", max_num_iterations, 1)
//       .Above("loss_scale", loss_scale, 0)
//       .AreKept();
class OptionBounds {
 public:
  explicit OptionBounds(std::string* error) : error_(error) {}

  OptionBounds& AtLeast(const char* name, double value, double bound) {
    return Require(value >= bound, name, value, ">= ", bound);
  }
  OptionBounds& Above(const char* name, double value, double bound) {
    return Require(value > bound, name, value, "> ", bound);
  }
  OptionBounds& Within(const char* name, double value, double min, double max) {
    std::ostringstream range;
    range << "in [" << min << ", " << max << "]";
    return Require(value >= min && value <= max, name, value, range.str());
  }
  // Options within options.
  template <typename Options>
  OptionBounds& Valid(const Options& options) {
    are_kept_ = are_kept_ && options.IsValid(error_);
    return *this;
  }

  bool AreKept() const { return are_kept_; }

 private:
  OptionBounds& Require(bool holds,
                        const char* name,
                        double value,
                        const std::string& relation,
                        double bound) {
    std::ostringstream text;
    text << relation << bound;
    return Require(holds, name, value, text.str());
  }
  OptionBounds& Require(bool holds,
                        const char* name,
                        double value,
                        const std::string& requirement) {
    if (are_kept_ && !holds) {
      std::ostringstream message;
      message << name << " must be " << requirement << ", but is " << value;
      *error_ = message.str();
      are_kept_ = false;
    }
    return *this;
  }

  std::string* error_;
  bool are_kept_ = true;
};

}  // namespace dgsfm
