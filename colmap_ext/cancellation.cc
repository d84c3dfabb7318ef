#include "colmap_ext/cancellation.h"

namespace dgsfm {
namespace {

thread_local const CancellationFlag* current_flag = nullptr;

}  // namespace

CancellationScope::CancellationScope(const CancellationFlag* flag)
    : outer_(current_flag) {
  current_flag = flag;
}

CancellationScope::~CancellationScope() { current_flag = outer_; }

const CancellationFlag* CurrentCancellationFlag() { return current_flag; }

void ThrowIfCancelled() {
  if (current_flag != nullptr &&
      current_flag->load(std::memory_order_relaxed)) {
    throw Cancelled();
  }
}

}  // namespace dgsfm
