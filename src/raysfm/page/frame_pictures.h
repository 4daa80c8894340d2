#pragma once

#include <atomic>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/frames/frame_set.h"
#include "raysfm/frames/frame_source.h"

namespace raysfm {

// Small pictures of the frames of an input, read when they are asked for. Inputs are read forwards: for an
// earlier frame than the last one the input is opened again, unless its picture is still kept. At most 64 MiB
// of them are. Any thread may ask.
class FramePictures {
 public:
  // `inputs` and `range` as `track` or `solve` was given them; `mono`: the first camera of a layout alone.
  FramePictures(std::vector<std::string> inputs, bool mono, const TimeRange& range = {});

  // Opens the input. Errors: bad input, where it cannot be read any more.
  Result<void> open();
  int streams() const { return streams_; }

  // JPEG of at most 640 pixels a side of frame `frame` of a stream, which begins to read where it must. Who
  // asks while another picture is being looked for ends that search. Errors: bad input, where there is no
  // such frame or it is damaged, or somebody else has asked meanwhile.
  Result<std::string> jpeg(int frame, int stream);

 private:
  using Key = std::pair<int, int>;  // frame, stream

  Result<void> read_up_to(int frame, int wish);
  Result<void> keep(const std::vector<InputFrame>& frames);
  void forget_far_from(int frame);

  std::vector<std::string> inputs_;
  bool mono_ = false;
  TimeRange range_;
  int streams_ = 0;

  std::mutex reading_;  // what follows, and is held while a frame is read
  Input input_;
  std::optional<FrameSetReader> reader_;
  int next_ = 0;  // frame that the reader gives next
  std::map<Key, std::string> kept_;
  size_t kept_bytes_ = 0;

  std::atomic<int> wishes_ = 0;  // made so far
};

}  // namespace raysfm
