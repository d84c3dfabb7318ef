#include "colmap_ext/progress.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <utility>

#include <unistd.h>

namespace dgsfm {
namespace {

thread_local const ProgressListener* current_listener = nullptr;

// Time without a line after which one is printed before its turn.
constexpr double kMaxLineIntervalS = 60;

}  // namespace

ProgressScope::ProgressScope(ProgressListener listener)
    : listener_(std::move(listener)), outer_(current_listener) {
  current_listener = &listener_;
}

ProgressScope::~ProgressScope() { current_listener = outer_; }

struct Progress::Impl {
  using Clock = std::chrono::steady_clock;

  const ProgressListener* listener = current_listener;

  std::string label;
  size_t total;
  size_t total_work;
  double line_interval_s;
  bool is_terminal = isatty(STDERR_FILENO);
  Clock::time_point start = Clock::now();
  std::mutex mutex;
  size_t num_done = 0;
  size_t work_done = 0;
  // Tenth of a second of the last bar, tenth of the work of the last line.
  int64_t last_shown = 0;
  double last_line_s = 0;

  double Seconds() const {
    return std::chrono::duration<double>(Clock::now() - start).count();
  }

  double SecondsLeft() const {
    if (work_done == 0) return 0;
    return Seconds() * (double(total_work) / double(work_done) - 1);
  }

  void ShowBar() const {
    const std::string full(30 * num_done / total, '=');
    std::fprintf(stderr,
                 "\r%s [%-30s] %zu/%zu, %.0f s left \033[K",
                 label.c_str(),
                 full.c_str(),
                 num_done,
                 total,
                 SecondsLeft());
  }

  void ShowLine() {
    if (Seconds() - last_line_s < line_interval_s) return;
    last_line_s = Seconds();
    std::fprintf(stderr,
                 "%s: %zu/%zu, %.1f s, %.0f s left\n",
                 label.c_str(),
                 num_done,
                 total,
                 Seconds(),
                 SecondsLeft());
  }
};

Progress::Progress(const std::string& label,
                   size_t total,
                   size_t total_work,
                   double line_interval_s)
    : impl_(std::make_unique<Impl>()) {
  impl_->label = label;
  impl_->total = total;
  impl_->total_work = total_work;
  impl_->line_interval_s = line_interval_s;
}

Progress::~Progress() {
  if (impl_->listener == nullptr && impl_->is_terminal && impl_->num_done > 0) {
    std::fputs("\r\033[K", stderr);
  }
}

void Progress::Step(size_t work) {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  if (impl_->num_done >= impl_->total) return;
  ++impl_->num_done;
  impl_->work_done += work;
  if (impl_->listener != nullptr) {
    (*impl_->listener)(impl_->label, impl_->num_done, impl_->total);
    return;
  }
  const bool is_last = impl_->num_done == impl_->total;
  const int64_t now = impl_->is_terminal
                          ? static_cast<int64_t>(10 * impl_->Seconds())
                          : 10 * impl_->num_done / impl_->total;
  const bool is_line_due =
      !impl_->is_terminal &&
      impl_->Seconds() - impl_->last_line_s >= kMaxLineIntervalS;
  if (now == impl_->last_shown && !is_last && !is_line_due) return;
  impl_->last_shown = now;
  impl_->is_terminal ? impl_->ShowBar() : impl_->ShowLine();
}

void Progress::Expect(size_t total) {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  impl_->total = impl_->total_work = std::max(total, impl_->num_done + 1);
}

IterationProgress::IterationProgress(const std::string& label,
                                     double tolerance,
                                     size_t max_num_steps)
    : tolerance_(tolerance), max_num_steps_(max_num_steps) {
  if (!label.empty()) {
    progress_ = std::make_unique<Progress>(label, max_num_steps);
  }
}

void IterationProgress::Step(double relative_decrease) {
  if (progress_) {
    progress_->Expect(num_steps_ + 1 + NumStepsLeft(relative_decrease));
    progress_->Step();
  }
  ++num_steps_;
  if (relative_decrease > 0) last_decrease_ = relative_decrease;
}

// At least one: the last step cannot be told before it is done.
size_t IterationProgress::NumStepsLeft(double relative_decrease) const {
  const double max_num = double(max_num_steps_) - double(num_steps_) - 1;
  const double num = relative_decrease > 0 &&
                             relative_decrease < last_decrease_ &&
                             tolerance_ > 0
                         ? std::log(relative_decrease / tolerance_) /
                               std::log(last_decrease_ / relative_decrease)
                         : max_num;
  return size_t(std::max(1.0, std::min(std::ceil(num), max_num)));
}

}  // namespace dgsfm
