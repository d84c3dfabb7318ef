// Contract checks of the project. A failed check is a caller's mistake and
// throws std::invalid_argument; wrong user input is reported by
// std::runtime_error with a message that names the file, image or pair.
// Nothing in the libraries aborts or exits.

#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace dgsfm::internal {

// Collects the streamed message and throws at the end of the full expression.
class CheckFailure {
 public:
  CheckFailure(const char* file, int line, const char* expression) {
    message_ << file << ":" << line << ": check failed: " << expression << " ";
  }
  [[noreturn]] ~CheckFailure() noexcept(false) {
    throw std::invalid_argument(message_.str());
  }
  template <typename T>
  CheckFailure& operator<<(const T& value) {
    message_ << value;
    return *this;
  }

 private:
  std::ostringstream message_;
};

}  // namespace dgsfm::internal

// Usage: DGSFM_CHECK(x > 0) << "x = " << x;
#define DGSFM_CHECK(condition) \
  if (condition) {             \
  } else                       \
    ::dgsfm::internal::CheckFailure(__FILE__, __LINE__, #condition)
