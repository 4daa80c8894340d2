#pragma once

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <queue>
#include <thread>
#include <vector>

namespace raysfm {

// Threads to work with where `wanted` are asked for; 0: as many as the machine has.
inline int thread_count(int wanted) {
  return wanted > 0 ? wanted : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

// Fixed set of worker threads. With zero workers, work runs in the calling thread, so one code path serves
// any number of threads and results cannot depend on it.
class ThreadPool {
 public:
  explicit ThreadPool(int workers);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int workers() const { return static_cast<int>(threads_.size()); }

  // Runs `work` on a worker and hands its value over. With zero workers the future is already fulfilled.
  template <typename Work>
  auto submit(Work work) -> std::future<decltype(work())> {
    auto task = std::make_shared<std::packaged_task<decltype(work())()>>(std::move(work));
    auto future = task->get_future();
    enqueue([task] { (*task)(); });
    return future;
  }

  // Calls body(i) for i in [0, count), in any order, and returns when all have run. The calling thread takes
  // part. The body must not depend on the order. What it throws, memory that is not to be had, is thrown here
  // once no thread runs it any more; the rest of the indices may then be left out.
  void parallel_for(int count, const std::function<void(int)>& body);

 private:
  void enqueue(std::function<void()> work);
  void run();

  std::vector<std::jthread> threads_;
  std::queue<std::function<void()>> queue_;
  std::mutex mutex_;
  std::condition_variable available_;
  bool stopping_ = false;
};

}  // namespace raysfm
