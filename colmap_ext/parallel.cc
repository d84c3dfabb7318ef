#include "colmap_ext/parallel.h"

#include "colmap_ext/cancellation.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <list>
#include <mutex>
#include <thread>

namespace dgsfm {

namespace {

// Threads that wait for work, as loops are many and short: started when they
// are first needed, and never joined, since they hold nothing.
class ThreadPool {
 public:
  static ThreadPool& Get() {
    static ThreadPool* const pool = new ThreadPool();
    return *pool;
  }

  // Calls work() here and, as far as the system has them, on as many further
  // threads, which may be fewer where others use them. Returns when all calls
  // have.
  void Run(size_t num_helpers, const std::function<void()>& work) {
    Task task = {&work, num_helpers};
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      tasks_.push_back(&task);
      StartThreads(num_helpers);
    }
    has_task_.notify_all();
    work();
    std::unique_lock<std::mutex> lock(mutex_);
    tasks_.remove(&task);
    has_finished_.wait(lock, [&] { return task.num_running == 0; });
  }

 private:
  struct Task {
    const std::function<void()>* work;
    size_t num_open;
    size_t num_running = 0;
  };

  void StartThreads(size_t count) {
    try {
      for (; num_threads_ < count; ++num_threads_) {
        std::thread([this] { Serve(); }).detach();
      }
    } catch (const std::exception&) {
      // The system has no more threads for us: those there are do the work.
    }
  }

  void Serve() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      has_task_.wait(lock, [this] { return !tasks_.empty(); });
      Task* task = tasks_.front();
      if (--task->num_open == 0) tasks_.pop_front();
      ++task->num_running;
      lock.unlock();
      (*task->work)();
      lock.lock();
      if (--task->num_running == 0) has_finished_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable has_task_;
  std::condition_variable has_finished_;
  // Those that further threads may join.
  std::list<Task*> tasks_;
  size_t num_threads_ = 0;
};

}  // namespace

int EffectiveNumThreads(int num_threads) {
  if (num_threads > 0) return num_threads;
  return std::max(1u, std::thread::hardware_concurrency());
}

void ParallelFor(size_t count,
                 int num_threads,
                 const std::function<void(size_t)>& function) {
  const size_t num_workers =
      std::min<size_t>(EffectiveNumThreads(num_threads), count);
  if (num_workers <= 1) {
    for (size_t i = 0; i < count; ++i) {
      ThrowIfCancelled();
      function(i);
    }
    return;
  }
  std::atomic<size_t> next(0);
  std::exception_ptr error;
  std::mutex error_mutex;
  const CancellationFlag* flag = CurrentCancellationFlag();
  const auto work = [&]() {
    const CancellationScope scope(flag);
    for (size_t i = next++; i < count; i = next++) {
      try {
        ThrowIfCancelled();
        function(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(error_mutex);
        if (!error) error = std::current_exception();
        next = count;
      }
    }
  };
  ThreadPool::Get().Run(num_workers - 1, work);
  if (error) std::rethrow_exception(error);
}

}  // namespace dgsfm
