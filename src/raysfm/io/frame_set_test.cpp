#include "raysfm/io/frame_set.h"

#include <gtest/gtest.h>

namespace raysfm {
namespace {

// Empty frames at given times.
class TimedStream : public FrameSource {
 public:
  explicit TimedStream(std::vector<double> times) : times_(std::move(times)) {}
  Result<std::optional<InputFrame>> next() override {
    if (at_ == times_.size()) return std::optional<InputFrame>();
    InputFrame frame;
    frame.index = static_cast<int>(at_);
    frame.timestamp = times_[at_++];
    return std::optional<InputFrame>(std::move(frame));
  }
  int width() const override { return 1; }
  int height() const override { return 1; }
  int frame_count() const override { return static_cast<int>(times_.size()); }
  std::string description() const override { return "stream of " + std::to_string(times_.size()); }

 private:
  std::vector<double> times_;
  size_t at_ = 0;
};

using Streams = std::vector<std::unique_ptr<FrameSource>>;

Streams streams_of(const std::vector<std::vector<double>>& times) {
  Streams streams;
  for (const auto& t : times) streams.push_back(std::make_unique<TimedStream>(t));
  return streams;
}

// Frames that are read before the end or an error, whose message is stored.
int sets_read(FrameSetReader& reader, std::string* error) {
  for (int count = 0;; ++count) {
    const Result<std::vector<InputFrame>> frames = reader.next();
    if (!frames) *error = frames.error().message;
    if (!frames || frames->empty()) return count;
    for (const InputFrame& frame : *frames) EXPECT_EQ(frame.index, count);
  }
}

TEST(FrameSet, StreamsInStep) {
  const Streams streams = streams_of({{0, 1, 2}, {0.1, 0.9, 2.2}, {0, 1, 2}});
  FrameSetReader reader(streams);
  std::string error;
  EXPECT_EQ(sets_read(reader, &error), 3);
  EXPECT_EQ(error, "");
  EXPECT_EQ(reader.note(), "");
}

TEST(FrameSet, TheShortestStreamIsTheEnd) {
  const Streams streams = streams_of({{0, 1, 2}, {0, 1}});
  FrameSetReader reader(streams);
  std::string error;
  EXPECT_EQ(sets_read(reader, &error), 2);
  EXPECT_EQ(error, "");
  EXPECT_NE(reader.note().find("stream of 2 ends after 2 frames"), std::string::npos) << reader.note();
}

TEST(FrameSet, StreamsOutOfStepAreRefused) {
  const Streams drifting = streams_of({{0, 1, 2, 3}, {0, 1.2, 2.6, 3.9}});
  FrameSetReader reader(drifting);
  std::string error;
  EXPECT_EQ(sets_read(reader, &error), 2);
  EXPECT_NE(error.find("frame 2: timestamp 2.6"), std::string::npos) << error;
  // From the start: told with the second frame, when the interval is known.
  const Streams shifted = streams_of({{0, 1, 2}, {0.7, 1.7, 2.7}});
  FrameSetReader other(shifted);
  EXPECT_EQ(sets_read(other, &error), 1);
  EXPECT_NE(error.find("half a frame, 0.5 s"), std::string::npos) << error;
}

}  // namespace
}  // namespace raysfm
