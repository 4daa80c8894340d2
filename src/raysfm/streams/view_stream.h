#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "raysfm/core/thread_pool.h"
#include "raysfm/core/timer.h"
#include "raysfm/frames/frame_set.h"
#include "raysfm/image/repeat_watch.h"
#include "raysfm/views/view_archive.h"
#include "raysfm/views/view_maker.h"

namespace raysfm {

// Views that are only passed over: those before `end`. Some of them are needed all the same.
struct PassedViews {
  int end = 0;
  ViewsNeeded needed = {};
};

// Views of a rig in order, decoded and detected ahead of time. With one thread everything happens in the
// calls of next(); the views are the same. Frame i of every stream belongs to view i. The views end with the
// first stream that ends, of which note() tells; streams whose timestamps drift apart are an error. A frame
// with a defect makes the view one. Frames that repeat the pictures of one before are views without cameras,
// which name it.
class ViewStream {
 public:
  // At least one stream and one camera. The sources and what the masks point to must outlive the stream.
  // Views that are passed over have no images, unless they are needed.
  ViewStream(const std::vector<std::unique_ptr<FrameSource>>& sources, ViewMaker maker, int threads,
             PassedViews passed = {});
  ~ViewStream();
  ViewStream(const ViewStream&) = delete;
  ViewStream& operator=(const ViewStream&) = delete;

  // Whether corners are detected ahead of time, which they are at first. Changes nothing in views once they
  // are detected.
  void detect_ahead(bool ahead) { detect_ahead_ = ahead; }

  // The next view; null at the end.
  Result<ViewPtr> next();

  // Ends reading, wherever it is, and tells the time that decoding took. next() may not be called again.
  const StageTiming& finish();

  // What the user should know though it is no error; complete once next() has returned null.
  std::string note() const;

 private:
  using Item = Result<ViewPtr>;
  using Frames = std::vector<InputFrame>;  // one of each stream

  std::future<Item> read();
  struct Showing {
    int same_as = -1, repeats = 0;  // as in View
  };
  Item made(Frames frames, const Showing& shown) const;
  Showing showing(const Frames& frames);
  void read_ahead(const std::stop_token& stop);

  FrameSetReader sources_;
  ViewMaker maker_;
  const PassedViews passed_;
  std::atomic<bool> detect_ahead_ = true;
  RepeatWatch repeats_;
  StageTiming decode_timing_;
  std::unique_ptr<ThreadPool> pool_;  // detection
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<std::future<Item>> queue_;
  bool ended_ = false;
  std::jthread reader_;
};

}  // namespace raysfm
