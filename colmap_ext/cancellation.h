// Ends long work that another thread does not want any more.

#pragma once

#include <atomic>
#include <exception>

namespace dgsfm {

// Not a std::runtime_error, which handlers take for faulty input.
class Cancelled : public std::exception {
 public:
  const char* what() const noexcept override { return "cancelled"; }
};

// Set by any thread.
using CancellationFlag = std::atomic<bool>;

// While this lives, the calling thread, with those that ParallelFor starts for
// it, works under the flag. Scopes nest; a null flag is one that is never set.
class CancellationScope {
 public:
  explicit CancellationScope(const CancellationFlag* flag);
  ~CancellationScope();
  CancellationScope(const CancellationScope&) = delete;
  CancellationScope& operator=(const CancellationScope&) = delete;

 private:
  const CancellationFlag* outer_;
};

// That of the innermost scope of this thread, or null.
const CancellationFlag* CurrentCancellationFlag();

// Throws Cancelled once the flag of this thread's scope is set. ParallelFor
// calls it before each item, other loops that take seconds should.
void ThrowIfCancelled();

}  // namespace dgsfm
