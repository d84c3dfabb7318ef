#include "python/src/call.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/progress.h"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <glog/logging.h>
#include <nanobind/stl/string.h>
#include <signal.h>

namespace dgsfm {
namespace {

namespace nb = nanobind;

constexpr auto kPollInterval = std::chrono::milliseconds(50);
// By glog's severities.
constexpr int kPythonLevels[] = {20, 30, 40, 50};

// Threads that log have not Python's lock, so that their lines wait for one
// that has.
class LogQueue : public google::LogSink {
 public:
  void send(google::LogSeverity severity,
            const char* /*full_filename*/,
            const char* /*base_filename*/,
            int /*line*/,
            const google::LogMessageTime& /*time*/,
            const char* message,
            size_t length) override {
    const std::lock_guard<std::mutex> lock(mutex_);
    lines_.emplace_back(severity, std::string(message, length));
  }

  void Drain() {
    std::vector<std::pair<google::LogSeverity, std::string>> lines;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      lines.swap(lines_);
    }
    if (lines.empty()) return;
    const nb::object logger =
        nb::module_::import_("logging").attr("getLogger")("dgsfm");
    for (const auto& [severity, text] : lines) {
      // Names of files need not be UTF-8.
      const nb::object message = nb::steal(PyUnicode_DecodeUTF8(
          text.data(), static_cast<Py_ssize_t>(text.size()), "replace"));
      logger.attr("log")(kPythonLevels[severity], "%s", message);
    }
  }

 private:
  std::mutex mutex_;
  std::vector<std::pair<google::LogSeverity, std::string>> lines_;
};

// Outlives all threads.
LogQueue* Log() {
  static LogQueue* const log = new LogQueue();
  return log;
}

// What the work has reached, for another thread to show.
class LatestProgress {
 public:
  void Set(const std::string& label, size_t done, size_t total) {
    const std::lock_guard<std::mutex> lock(mutex_);
    // The end of a loop is shown however short the next one is.
    if (!latest_.empty() && latest_.back().label == label) latest_.pop_back();
    latest_.push_back({label, done, total});
  }

  void Show(const nb::object& callback) {
    std::vector<Item> items;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      items.swap(latest_);
    }
    if (callback.is_none()) return;
    for (const Item& item : items) callback(item.label, item.done, item.total);
  }

 private:
  struct Item {
    std::string label;
    size_t done = 0;
    size_t total = 0;
  };

  std::mutex mutex_;
  std::vector<Item> latest_;
};

// A thread with all signals blocked: Python's handlers would interrupt its
// reading and writing.
std::thread StartWithoutSignals(const std::function<void()>& function) {
  sigset_t all;
  sigset_t previous;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &previous);
  std::exception_ptr error;
  std::thread thread;
  try {
    thread = std::thread(function);
  } catch (...) {
    error = std::current_exception();
  }
  pthread_sigmask(SIG_SETMASK, &previous, nullptr);
  if (error) std::rethrow_exception(error);
  return thread;
}

}  // namespace

void RunWork(const std::function<void()>& work, const nb::object& progress) {
  CancellationFlag is_cancelled(false);
  LatestProgress latest;
  std::mutex mutex;
  std::condition_variable ended;
  bool has_ended = false;
  std::exception_ptr error;
  std::thread worker = StartWithoutSignals([&] {
    const CancellationScope cancellation(&is_cancelled);
    const ProgressScope scope(
        [&](const std::string& label, size_t done, size_t total) {
          latest.Set(label, done, total);
        });
    try {
      work();
    } catch (...) {
      error = std::current_exception();
    }
    const std::lock_guard<std::mutex> lock(mutex);
    has_ended = true;
    ended.notify_one();
  });

  std::exception_ptr interrupt;
  for (bool is_over = false; !is_over;) {
    {
      const nb::gil_scoped_release release;
      std::unique_lock<std::mutex> lock(mutex);
      is_over = ended.wait_for(lock, kPollInterval, [&] { return has_ended; });
    }
    try {
      Log()->Drain();
      latest.Show(progress);
      if (PyErr_CheckSignals() != 0) throw nb::python_error();
    } catch (...) {
      if (!interrupt) interrupt = std::current_exception();
      is_cancelled = true;
    }
  }
  worker.join();
  if (interrupt) std::rethrow_exception(interrupt);
  if (error) std::rethrow_exception(error);
}

void KeepLogForPython() {
  static const bool is_initialized = [] {
    if (!google::IsGoogleLoggingInitialized()) {
      google::InitGoogleLogging("dgsfm");
    }
    for (int severity = 0; severity < google::NUM_SEVERITIES; ++severity) {
      google::SetLogDestination(severity, "");
    }
    FLAGS_stderrthreshold = google::NUM_SEVERITIES;
    google::AddLogSink(Log());
    return true;
  }();
  (void)is_initialized;
}

void LogToStderr() {
  google::RemoveLogSink(Log());
  FLAGS_logtostderr = true;
}

}  // namespace dgsfm
