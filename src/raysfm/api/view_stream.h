#pragma once

#include <condition_variable>
#include <deque>
#include <future>
#include <memory>
#include <mutex>
#include <thread>

#include "raysfm/core/thread_pool.h"
#include "raysfm/core/timer.h"
#include "raysfm/io/frame_source.h"
#include "raysfm/odometry/view.h"

namespace raysfm {

// Views of a stream in order, decoded and detected ahead of time. With one thread everything happens in the
// calls of next(); the views are the same.
class ViewStream {
 public:
  // `source` must outlive the stream. `options.mask` may be empty.
  ViewStream(FrameSource& source, const HarrisOptions& options, int threads);
  ~ViewStream();
  ViewStream(const ViewStream&) = delete;
  ViewStream& operator=(const ViewStream&) = delete;

  // The next view; null at the end.
  Result<ViewPtr> next();

  // Complete once next() has returned null.
  const StageTiming& decode_timing() const { return decode_timing_; }

 private:
  using Item = Result<ViewPtr>;
  std::future<Item> read();
  void read_ahead(const std::stop_token& stop);

  FrameSource& source_;
  HarrisOptions options_;
  StageTiming decode_timing_;
  std::unique_ptr<ThreadPool> pool_;  // detection
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<std::future<Item>> queue_;
  bool ended_ = false;
  std::jthread reader_;
};

}  // namespace raysfm
