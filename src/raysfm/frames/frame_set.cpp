#include "raysfm/frames/frame_set.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace raysfm {
namespace {

// A frame is nearer than another where its distance is less than this part of the other's: streams half a
// frame apart must not change partners because their timestamps are rounded.
constexpr double kNearer = 0.8;
// Cameras that trigger each other are much nearer; of a frame interval.
constexpr double kInStep = 0.25;

double distance(const std::optional<InputFrame>& frame, double timestamp) {
  return frame ? std::abs(frame->timestamp - timestamp) : HUGE_VAL;
}

}  // namespace

FrameSetReader::FrameSetReader(const std::vector<std::unique_ptr<FrameSource>>& streams) {
  for (const auto& stream : streams) streams_.push_back({stream.get(), {}, {}});
}

// One stream alone is not read ahead: a camera would show what has been.
Result<void> FrameSetReader::advance(Ahead* stream) {
  const bool alone = streams_.size() == 1;
  do {
    Result<std::optional<InputFrame>> frame = stream->source->next();
    if (!frame) return frame.error();
    stream->now = alone ? std::move(*frame) : std::exchange(stream->later, std::move(*frame));
  } while (!alone && !stream->now && stream->later);
  return {};
}

// Leaves out frames that are farther from the timestamp than the one after.
Result<void> FrameSetReader::go_to(double timestamp, Ahead* stream) {
  while (!stream->now || distance(stream->later, timestamp) < kNearer * distance(stream->now, timestamp)) {
    if (auto r = advance(stream); !r) return r;
    if (!stream->now) return {};
  }
  return {};
}

// Whether the stream's frame belongs to the first stream's and not to the one after.
bool FrameSetReader::together(const Ahead& stream) const {
  const Ahead& first = streams_.front();
  const double apart = distance(stream.now, first.now->timestamp);
  return kNearer * apart <= distance(first.later, stream.now->timestamp) &&
         (interval_ == 0 || apart < interval_);
}

// Reads what next() needs. True where a stream has no frame any more.
Result<bool> FrameSetReader::at_end() {
  Ahead& first = streams_.front();
  if (auto r = advance(&first); !r) return r.error();
  if (first.now && first.later) interval_ = first.later->timestamp - first.now->timestamp;
  const FrameSource* ended = first.now ? nullptr : first.source;
  bool others = first.now.has_value();
  for (size_t i = 1; i < streams_.size(); ++i) {
    if (auto r = go_to(first.now ? first.now->timestamp : -HUGE_VAL, &streams_[i]); !r) return r.error();
    if (streams_[i].now) {
      others = true;
    } else if (!ended) {
      ended = streams_[i].source;
    }
  }
  if (ended && others) {
    end_note_ = fmt::format("{} ends after {} frames where others go on; these are left out",
                            ended->description(), frames_);
  }
  return ended != nullptr;
}

InputFrame FrameSetReader::take(Ahead* stream) {
  const InputFrame& first = *streams_.front().now;
  if (!together(*stream)) {
    InputFrame none;
    none.index = first.index;
    none.timestamp = first.timestamp;
    none.defect =
        fmt::format("{}: no frame of the instant {} s", stream->source->description(), first.timestamp);
    return none;
  }
  apart_ = std::max(apart_, distance(stream->now, first.timestamp));
  out_of_step_ |= distance(stream->now, first.timestamp) > kInStep * interval_;
  return *std::exchange(stream->now, std::nullopt);
}

Result<std::vector<InputFrame>> FrameSetReader::next() {
  const Result<bool> end = at_end();
  if (!end) return end.error();
  std::vector<InputFrame> frames;
  if (*end) return frames;
  for (size_t i = 1; i < streams_.size(); ++i) frames.push_back(take(&streams_[i]));
  frames.insert(frames.begin(), *std::exchange(streams_.front().now, std::nullopt));
  remember(frames);
  return frames;
}

void FrameSetReader::remember(const std::vector<InputFrame>& frames) {
  ++frames_;
  const auto defect =
      std::ranges::find_if(frames, [](const InputFrame& frame) { return !frame.defect.empty(); });
  if (defect != frames.end() && defects_++ == 0) first_defect_ = defect->defect;
}

std::string FrameSetReader::note() const {
  std::string text;
  const auto add = [&](const std::string& part) { text += (text.empty() ? "" : "; ") + part; };
  if (defects_ > 0)
    add(fmt::format("{} of {} frames cannot be used, the first: {}", defects_, frames_, first_defect_));
  if (out_of_step_)
    add(fmt::format("the streams are not synchronised, frames are up to {:.3g} s apart", apart_));
  if (!end_note_.empty()) add(end_note_);
  return text;
}

}  // namespace raysfm
