#pragma once

#include <memory>
#include <string>
#include <vector>

#include "raysfm/io/frame_source.h"

namespace raysfm {

// Reads the streams of a rig in step: one frame of each, all of one instant.
class FrameSetReader {
 public:
  // At least one stream; they must outlive the reader.
  explicit FrameSetReader(const std::vector<std::unique_ptr<FrameSource>>& streams) : streams_(streams) {}

  // The next frames, in the order of the streams; empty at the end, which is that of the shortest stream.
  // Errors: those of the streams; bad input where the timestamps of two streams differ by half a frame
  // interval or more (from the second frame on, when the interval is known).
  Result<std::vector<InputFrame>> next();

  // What the user should know: how many frames have a defect, that a stream goes on where another ends.
  // Empty: nothing.
  std::string note() const;

 private:
  Result<void> check_step(const std::vector<InputFrame>& frames);

  const std::vector<std::unique_ptr<FrameSource>>& streams_;
  std::string end_note_, first_defect_;
  size_t defects_ = 0;         // sets with one
  double last_timestamp_ = 0;  // of the first stream
  double first_offset_ = 0;    // largest difference of timestamps in the first frame
  size_t frames_ = 0;
};

}  // namespace raysfm
