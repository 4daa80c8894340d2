#include "raysfm/frames/frame_set.h"

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

// Timestamps of the second stream by frame of the first; a negative one stands for a defect.
std::vector<double> partners(const std::vector<double>& first, const std::vector<double>& second,
                             std::string* note) {
  const Streams streams = streams_of({first, second});
  FrameSetReader reader(streams);
  std::vector<double> found;
  for (;;) {
    const Result<std::vector<InputFrame>> frames = reader.next();
    EXPECT_TRUE(frames);
    if (!frames || frames->empty()) break;
    EXPECT_EQ(frames->size(), 2u);
    EXPECT_EQ(frames->at(0).index, static_cast<int>(found.size()));
    EXPECT_EQ(frames->at(0).timestamp, first[found.size()]);
    EXPECT_EQ(frames->at(0).defect, "");
    const InputFrame& other = frames->at(1);
    EXPECT_EQ(other.defect.empty(), other.defect.find("no frame of the instant") == std::string::npos);
    found.push_back(other.defect.empty() ? other.timestamp : -1);
  }
  *note = reader.note();
  return found;
}

TEST(FrameSet, FramesNearestInTimeBelongTogether) {
  using Times = std::vector<double>;
  std::string note;
  // Half a frame apart.
  EXPECT_EQ(partners({0, 1, 2, 3}, {0.5, 1.5, 2.5, 3.5}, &note), (Times{0.5, 1.5, 2.5, 3.5}));
  EXPECT_NE(note.find("not synchronised, frames are up to 0.5 s apart"), std::string::npos) << note;
  // Half a frame apart, in milliseconds.
  EXPECT_EQ(partners({0, 67, 133, 200, 267, 333}, {33, 100, 167, 233, 300, 367}, &note),
            (Times{33, 100, 167, 233, 300, 367}));
  // One started later, or earlier.
  EXPECT_EQ(partners({0, 1, 2, 3, 4}, {2.1, 3.1, 4.1}, &note), (Times{-1, -1, 2.1, 3.1, 4.1}));
  EXPECT_NE(note.find("2 of 5 frames cannot be used"), std::string::npos) << note;
  EXPECT_EQ(partners({2.1, 3.1, 4.1}, {0, 1, 2, 3, 4}, &note), (Times{2, 3, 4}));
  EXPECT_EQ(note, "");
  // One lost a frame.
  EXPECT_EQ(partners({0, 1, 2, 3, 4}, {0, 1, 3, 4}, &note), (Times{0, 1, -1, 3, 4}));
  EXPECT_EQ(partners({0, 1, 3, 4}, {0, 1, 2, 3, 4}, &note), (Times{0, 1, 3, 4}));
  // One has half the rate.
  EXPECT_EQ(partners({0, 1, 2, 3, 4}, {0.1, 2.1, 4.1}, &note), (Times{0.1, -1, 2.1, -1, 4.1}));
  // Nothing in common.
  EXPECT_EQ(partners({0, 1, 2}, {100, 101, 102}, &note), (Times{-1, -1, -1}));
  EXPECT_NE(note.find("3 of 3 frames cannot be used"), std::string::npos) << note;
}

}  // namespace
}  // namespace raysfm
