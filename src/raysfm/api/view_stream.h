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
  // Views of the part `roi` of each frame, which lies inside it; empty (w = 0): of the whole frame. `source`
  // and what `options.mask` points to must outlive the stream; the mask has the size of the views or is
  // empty.
  ViewStream(FrameSource& source, const Roi& roi, const HarrisOptions& options, int threads);
  ~ViewStream();
  ViewStream(const ViewStream&) = delete;
  ViewStream& operator=(const ViewStream&) = delete;

  // The next view; null at the end.
  Result<ViewPtr> next();

  // Ends reading, wherever it is, and tells the time that decoding took. next() may not be called again.
  const StageTiming& finish();

 private:
  using Item = Result<ViewPtr>;
  std::future<Item> read();
  Item detected(InputFrame frame) const;
  void read_ahead(const std::stop_token& stop);

  FrameSource& source_;
  Roi roi_;
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
