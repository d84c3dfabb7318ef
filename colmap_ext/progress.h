// Progress of a long loop on stderr: on a terminal a bar with the time left,
// which goes away at the end; otherwise a plain line at every tenth of the
// work, unless the line before is of the last seconds, and at least one a
// minute, as far as items end. Or for a listener.

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
  // Items of equal work turn out to be so many altogether, more than are done.
  void Expect(size_t total);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Progress of an iteration that ends once the relative decrease of its cost by
// a step is below a tolerance, or with its last step. The steps that are left
// are estimated by how fast the decreases fall. Nothing is shown without a
// label.
class IterationProgress {
 public:
  IterationProgress(const std::string& label,
                    double tolerance,
                    size_t max_num_steps);
  // A step is done. One that was rejected has no decrease.
  void Step(double relative_decrease = 0);

 private:
  size_t NumStepsLeft(double relative_decrease) const;

  const double tolerance_;
  const size_t max_num_steps_;
  size_t num_steps_ = 0;
  double last_decrease_ = 0;
  std::unique_ptr<Progress> progress_;
};

}  // namespace dgsfm
