#include "raysfm/core/thread_pool.h"

#include <atomic>
#include <exception>
#include <memory>
#include <new>

#include "raysfm/core/start_threads.h"

namespace raysfm {

ThreadPool::ThreadPool(int workers) {
  start_threads(
      workers, [this] { run(); }, &threads_);
}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  available_.notify_all();
  threads_.clear();
}

void ThreadPool::enqueue(std::function<void()> work) {
  if (threads_.empty()) {
    work();
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    queue_.push(std::move(work));
  }
  available_.notify_one();
}

void ThreadPool::run() {
  for (;;) {
    std::function<void()> work;
    {
      std::unique_lock lock(mutex_);
      available_.wait(lock, [this] { return stopping_ || !queue_.empty(); });
      if (queue_.empty()) return;
      work = std::move(queue_.front());
      queue_.pop();
    }
    work();
  }
}

void ThreadPool::parallel_for(int count, const std::function<void(int)>& body) {
  struct Shared {
    std::atomic<int> next = 0;
    std::atomic<int> done = 0;
    std::atomic<bool> failed = false;
    std::mutex mutex;
    std::condition_variable finished;
    std::exception_ptr failure;
  };
  // Shared, because a worker may look for more work after the caller has returned.
  auto shared = std::make_shared<Shared>();
  const auto work = [shared, count, body] {
    for (int i = shared->next++; i < count; i = shared->next++) {
      try {
        if (!shared->failed) body(i);
      } catch (...) {
        const std::lock_guard lock(shared->mutex);
        if (!shared->failed.exchange(true)) shared->failure = std::current_exception();
      }
      if (++shared->done == count) {
        const std::lock_guard lock(shared->mutex);
        shared->finished.notify_all();
      }
    }
  };
  try {
    for (int i = 0; i < workers() && i + 1 < count; ++i) enqueue(work);
  } catch (const std::bad_alloc&) {  // fewer threads change no result
  }
  work();
  std::unique_lock lock(shared->mutex);
  shared->finished.wait(lock, [&] { return shared->done >= count; });
  if (shared->failure) std::rethrow_exception(shared->failure);
}

}  // namespace raysfm
