// Progress of a long loop on stderr: a bar with time left on a terminal,
// otherwise a plain line at every tenth of the work.

#pragma once

#include <cstddef>
#include <memory>
#include <string>

namespace dgsfm {

class Progress {
 public:
  // The time left is estimated by work where items differ in it.
  Progress(const std::string& label, size_t total, size_t total_work);
  Progress(const std::string& label, size_t total)
      : Progress(label, total, total) {}
  // Finishes the bar.
  ~Progress();
  // One more item is done; callable from any thread.
  void Step(size_t work = 1);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dgsfm
