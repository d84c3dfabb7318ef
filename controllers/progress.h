// Progress of a long loop on stderr: on a terminal a bar with the time left,
// which goes away at the end; otherwise a plain line at every tenth of the
// work, unless the line before is of the last seconds. Or for a listener.

#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

namespace dgsfm {

// Gets label, number of items that are done, and total; by one thread at a
// time.
using ProgressListener =
    std::function<void(const std::string& label, size_t done, size_t total)>;

// While this lives, progress that the calling thread constructs goes to the
// listener instead of stderr.
class ProgressScope {
 public:
  explicit ProgressScope(ProgressListener listener);
  ~ProgressScope();
  ProgressScope(const ProgressScope&) = delete;
  ProgressScope& operator=(const ProgressScope&) = delete;

 private:
  const ProgressListener listener_;
  const ProgressListener* outer_;
};

class Progress {
 public:
  // The time left is estimated by work where items differ in it. Plain lines
  // have at least `line_interval_s` between them, the start counting as one
  // [s].
  Progress(const std::string& label,
           size_t total,
           size_t total_work,
           double line_interval_s = 10);
  Progress(const std::string& label, size_t total)
      : Progress(label, total, total) {}
  // Removes the bar.
  ~Progress();
  // One more item is done; callable from any thread.
  void Step(size_t work = 1);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dgsfm
