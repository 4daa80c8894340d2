#pragma once

#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

namespace raysfm {

// A few threads that share the passes of one loop after another. Unlike core's ThreadPool it allocates
// nothing per loop and wakes fast, for loops of a few hundred microseconds inside an iteration.
class WorkTeam {
 public:
  // `threads` >= 1, the caller among them.
  explicit WorkTeam(int threads = 1);
  ~WorkTeam();
  WorkTeam(const WorkTeam&) = delete;
  WorkTeam& operator=(const WorkTeam&) = delete;

  int threads() const { return static_cast<int>(workers_.size()) + 1; }

  // body(i) for every i in [0, count), in any order, by any thread of the team. The caller takes part, and it
  // returns when all have run. The body must not throw, must not depend on the order, and must not call
  // run().
  template <typename Body>
  void run(int count, const Body& body) {
    if (workers_.empty() || count < 2) {
      for (int i = 0; i < count; ++i) body(i);
      return;
    }
    run_shared(
        count, [](const void* b, int i) { (*static_cast<const Body*>(b))(i); }, &body);
  }

 private:
  using Call = void (*)(const void* body, int i);

  void run_shared(int count, Call call, const void* body);
  void take_part();
  void serve();

  std::vector<std::jthread> workers_;
  Call call_ = nullptr;
  const void* body_ = nullptr;
  int count_ = 0;
  alignas(64) std::atomic<int> next_ = 0;
  alignas(64) std::atomic<uint32_t> loop_ = 0;  // number of the loop that is run
  alignas(64) std::atomic<int> busy_ = 0;       // workers that have not finished it
  bool stopping_ = false;
};

}  // namespace raysfm
