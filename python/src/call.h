// How Python waits for work in C++.

#pragma once

#include <functional>

#include <nanobind/nanobind.h>

namespace dgsfm {

// Runs work in a thread of its own, without Python's global lock. Meanwhile the
// calling thread passes log lines to Python's logger "dgsfm", calls
// progress(label, done, total) unless it is None, and handles signals. An
// exception of these, such as KeyboardInterrupt, cancels the work and is
// thrown once it has ended; otherwise exceptions of the work are.
void RunWork(const std::function<void()>& work,
             const nanobind::object& progress);

// Makes log lines wait for RunWork instead of going to stderr.
void KeepLogForPython();
// Makes them go to stderr, as those of the program.
void LogToStderr();

}  // namespace dgsfm
