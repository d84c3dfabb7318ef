// Progress of a long loop on stderr: a bar with time left on a terminal,
// otherwise a plain line at every tenth of the work.

#pragma once

#include <cstddef>
#include <memory>
#include <string>

namespace dgsfm {

class Progress {
 public:
  Progress(const std::string& label, size_t total);
  // Finishes the bar.
  ~Progress();
  // One more item is done; callable from any thread.
  void Step();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dgsfm
