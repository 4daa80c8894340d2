#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "raysfm/frames/frame_source.h"

namespace raysfm {

// Reads the streams of a rig together: one frame of each, taken at about one instant.
class FrameSetReader {
 public:
  // At least one stream; they must outlive the reader.
  explicit FrameSetReader(const std::vector<std::unique_ptr<FrameSource>>& streams);

  // The next frame of the first stream, and of every other the one that is nearest to it in time and to no
  // other of its frames; where there is none, a frame with a defect. Empty at the end, which is that of the
  // shortest stream. Errors: those of the streams.
  Result<std::vector<InputFrame>> next();

  // What the user should know: how many frames have a defect, that the streams are not synchronised, that one
  // goes on where another ends. Empty: nothing.
  std::string note() const;

 private:
  // What is read of a stream and not given away.
  struct Ahead {
    FrameSource* source;
    std::optional<InputFrame> now, later;
  };

  Result<void> advance(Ahead* stream);
  Result<void> go_to(double timestamp, Ahead* stream);
  bool together(const Ahead& stream) const;
  Result<bool> at_end();
  InputFrame take(Ahead* stream);
  void remember(const std::vector<InputFrame>& frames);

  std::vector<Ahead> streams_;
  std::string end_note_, first_defect_;
  double interval_ = 0;  // of the first stream's last two frames; seconds
  double apart_ = 0;     // most that frames of a set are; seconds
  bool out_of_step_ = false;
  size_t frames_ = 0, defects_ = 0;  // sets
};

}  // namespace raysfm
