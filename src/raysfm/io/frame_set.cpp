#include "raysfm/io/frame_set.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace raysfm {

Result<void> FrameSetReader::check_step(const std::vector<InputFrame>& frames) {
  const double timestamp = frames.front().timestamp;
  const double interval = timestamp - last_timestamp_;
  for (size_t i = 1; i < frames.size(); ++i) {
    const double offset = std::abs(frames[i].timestamp - timestamp);
    if (frames_ == 0) first_offset_ = std::max(first_offset_, offset);
    const double largest = std::max(offset, first_offset_);
    if (frames_ == 0 || largest < 0.5 * interval) continue;
    return bad_input(
        fmt::format("{}: frame {}: timestamp {}; allowed: within half a frame, {:.4g} s, of {} in {}",
                    streams_[i]->description(), frames_, frames[i].timestamp, 0.5 * interval, timestamp,
                    streams_.front()->description()));
  }
  last_timestamp_ = timestamp;
  return {};
}

Result<std::vector<InputFrame>> FrameSetReader::next() {
  std::vector<InputFrame> frames;
  const FrameSource* ended = nullptr;
  for (const auto& stream : streams_) {
    Result<std::optional<InputFrame>> frame = stream->next();
    if (!frame) return frame.error();
    if (*frame) {
      frames.push_back(*std::move(*frame));
    } else if (!ended) {
      ended = stream.get();
    }
  }
  if (ended) {
    if (!frames.empty()) {
      end_note_ = fmt::format("{} ends after {} frames where others go on; these are left out",
                              ended->description(), frames_);
    }
    return std::vector<InputFrame>{};
  }
  const Result<void> in_step = check_step(frames);
  if (!in_step) return in_step.error();
  ++frames_;
  const auto defect =
      std::ranges::find_if(frames, [](const InputFrame& frame) { return !frame.defect.empty(); });
  if (defect != frames.end() && defects_++ == 0) first_defect_ = defect->defect;
  return frames;
}

std::string FrameSetReader::note() const {
  if (defects_ == 0) return end_note_;
  return fmt::format("{} of {} frames cannot be used, the first: {}{}{}", defects_, frames_, first_defect_,
                     end_note_.empty() ? "" : "; ", end_note_);
}

}  // namespace raysfm
