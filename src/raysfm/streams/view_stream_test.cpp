#include "raysfm/streams/view_stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <memory>

#include "support/texture.h"

namespace raysfm {
namespace {

// Squares of random grey, eight pixels wide: sharp, and no noise.
GrayImage squares(int width, int height, uint64_t seed) {
  const GrayImage grey = testing_support::random_image(width / 8, height / 8, seed);
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.row(y)[x] = grey.row(y / 8)[x / 8];
  }
  return image;
}

// Frames made on demand; an error instead of the frame `error_at`.
class MadeFrames : public FrameSource {
 public:
  explicit MadeFrames(int count, int error_at = -1, bool colour = false)
      : count_(count), error_at_(error_at), colour_(colour) {}

  Result<std::optional<InputFrame>> next() override {
    const int i = made++;
    if (ended_ || i >= count_) return std::optional<InputFrame>();
    if (i == error_at_) {
      ended_ = true;
      return bad_input("frame 5 of the test is broken");
    }
    InputFrame frame;
    frame.index = i;
    frame.timestamp = 0.25 * i;
    frame.name = "frame " + std::to_string(i);
    frame.gray = squares(width(), height(), 100 + i / times_each);
    if (colour_) frame.colors.rgb = testing_support::random_image(3 * width(), height(), 200 + i);
    if (i == defect_at) {
      frame.gray = {};
      frame.colors = {};
      frame.defect = "frame of the test is damaged";
    }
    return std::optional(std::move(frame));
  }
  int width() const override { return 96; }
  int height() const override { return 64; }
  int frame_count() const override { return count_; }
  std::string description() const override { return "made for a test"; }

  std::atomic<int> made = 0;  // calls of next()
  int defect_at = -1;
  int times_each = 1;  // that a picture is shown

 private:
  int count_, error_at_;
  bool colour_, ended_ = false;
};

bool same_pixels(GrayView a, GrayView b) {
  if (a.width != b.width || a.height != b.height) return false;
  for (int y = 0; y < a.height; ++y) {
    if (std::memcmp(a.row(y), b.row(y), a.width) != 0) return false;
  }
  return true;
}

// It is sharp: the image is there as taken.
GrayView picture_of(const CameraView& camera) {
  EXPECT_EQ(camera.octaves->first(), 0);
  return camera.octaves->at(0);
}

using Streams = std::vector<std::unique_ptr<FrameSource>>;

// A stream made of the arguments of MadeFrames, and the same as what it is.
struct OneStream {
  template <typename... Args>
  explicit OneStream(Args... args) {
    streams.push_back(std::make_unique<MadeFrames>(args...));
  }
  MadeFrames& source() { return static_cast<MadeFrames&>(*streams[0]); }
  Streams streams;
};

std::vector<ViewPtr> all_views(ViewStream& stream) {
  std::vector<ViewPtr> views;
  for (;;) {
    Result<ViewPtr> view = stream.next();
    if (!view) ADD_FAILURE() << view.error().message;
    if (!view || !*view) return views;
    views.push_back(*view);
  }
}

constexpr HarrisOptions kOptions{.max_features = 80, .mask = {}};

class ViewStreamTest : public testing::TestWithParam<int> {};  // threads

TEST_P(ViewStreamTest, ViewsComeInOrderAndAreThoseOfOneThread) {
  constexpr int kFrames = 40;
  OneStream one(kFrames);
  MadeFrames alone(kFrames);
  ViewStream stream(one.streams, ViewMaker({{0, {}, kOptions}}), GetParam());
  const std::vector<ViewPtr> views = all_views(stream);
  ASSERT_EQ(views.size(), size_t{kFrames});
  HarrisDetector detector;
  for (int i = 0; i < kFrames; ++i) {
    InputFrame frame = std::move(**alone.next());
    EXPECT_EQ(views[i]->frame, i);
    EXPECT_EQ(views[i]->timestamp, 0.25 * i);
    EXPECT_EQ(views[i]->name, frame.name);
    EXPECT_TRUE(same_pixels(picture_of(views[i]->cameras[0]), frame.gray)) << i;
    CameraView expected;
    expected.image = std::move(frame.gray);
    detect(detector, kOptions, &expected);
    ASSERT_GT(expected.features.size(), 20);
    EXPECT_EQ(views[i]->cameras[0].features.pixels, expected.features.pixels) << i;
  }
  Result<ViewPtr> after = stream.next();
  ASSERT_TRUE(after);
  EXPECT_EQ(*after, nullptr) << "after the end there is nothing";
  EXPECT_EQ(stream.finish().count, kFrames);
}

TEST_P(ViewStreamTest, APartOfTheFramesIsCut) {
  OneStream one(3, -1, true);
  MadeFrames alone(3, -1, true);
  const Roi roi{10, 7, 64, 48};
  ViewStream stream(one.streams, ViewMaker({{0, roi, kOptions}}), GetParam());
  for (const ViewPtr& view : all_views(stream)) {
    const InputFrame frame = std::move(**alone.next());
    const GrayView gray = frame.gray.view();
    const CameraView& camera = view->cameras[0];
    EXPECT_TRUE(same_pixels(picture_of(camera), {gray.row(7) + 10, 64, 48, gray.stride}));
    ASSERT_EQ(camera.rgb.size(), camera.features.pixels.size());
    for (int k = 0; k < camera.features.size(); ++k) {
      const int x = static_cast<int>(std::lround(camera.features.pixels[k].x())) + 10;
      const int y = static_cast<int>(std::lround(camera.features.pixels[k].y())) + 7;
      for (int c = 0; c < 3; ++c) ASSERT_EQ(camera.rgb[k][c], frame.colors.rgb.row(y)[3 * x + c]);
    }
  }
  EXPECT_EQ(one.source().made, 4) << "three frames and the end";
}

TEST_P(ViewStreamTest, CamerasShareAStreamOrHaveOneEach) {
  Streams streams;
  streams.push_back(std::make_unique<MadeFrames>(4));
  streams.push_back(std::make_unique<MadeFrames>(4, -1, true));
  MadeFrames alone(4);
  const Roi left{0, 0, 48, 64}, right{48, 0, 48, 64};
  ViewStream stream(streams, ViewMaker({{0, left, kOptions}, {1, {}, kOptions}, {0, right, kOptions}}),
                    GetParam());
  const std::vector<ViewPtr> views = all_views(stream);
  ASSERT_EQ(views.size(), 4u);
  for (const ViewPtr& view : views) {
    const InputFrame frame = std::move(**alone.next());
    const GrayView gray = frame.gray.view();
    ASSERT_EQ(view->cameras.size(), 3u);
    EXPECT_TRUE(same_pixels(picture_of(view->cameras[0]), {gray.row(0), 48, 64, gray.stride}));
    EXPECT_TRUE(same_pixels(picture_of(view->cameras[1]), gray));
    EXPECT_TRUE(same_pixels(picture_of(view->cameras[2]), {gray.row(0) + 48, 48, 64, gray.stride}));
    const auto coloured = [](const std::array<uint8_t, 3>& rgb) { return rgb[0] != rgb[1]; };
    EXPECT_TRUE(std::ranges::any_of(view->cameras[1].rgb, coloured));
    EXPECT_TRUE(std::ranges::none_of(view->cameras[0].rgb, coloured));
  }
  EXPECT_EQ(stream.note(), "");
}

TEST_P(ViewStreamTest, TheShortestStreamEndsTheViewsAndIsNamed) {
  Streams streams;
  for (const int frames : {9, 6}) streams.push_back(std::make_unique<MadeFrames>(frames));
  ViewStream stream(streams, ViewMaker({{0, {}, kOptions}, {1, {}, kOptions}}), GetParam());
  EXPECT_EQ(all_views(stream).size(), 6u);
  EXPECT_NE(stream.note().find("made for a test ends after 6 frames"), std::string::npos) << stream.note();
}

TEST_P(ViewStreamTest, AnErrorComesInItsTurnAndEndsTheStream) {
  OneStream one(20, 5);
  ViewStream stream(one.streams, ViewMaker({{0, {}, kOptions}}), GetParam());
  for (int i = 0; i < 5; ++i) {
    Result<ViewPtr> view = stream.next();
    ASSERT_TRUE(view) << view.error().message;
    ASSERT_TRUE(*view);
    EXPECT_EQ((*view)->frame, i);
  }
  Result<ViewPtr> broken = stream.next();
  ASSERT_FALSE(broken);
  EXPECT_EQ(broken.error().message, "frame 5 of the test is broken");
  EXPECT_EQ(broken.error().kind, ErrorKind::kBadInput);
  Result<ViewPtr> after = stream.next();
  ASSERT_TRUE(after);
  EXPECT_EQ(*after, nullptr);
}

TEST_P(ViewStreamTest, ADefectOfOneStreamIsOneOfTheViewAndNothingEnds) {
  Streams streams;
  for (int i = 0; i < 2; ++i) streams.push_back(std::make_unique<MadeFrames>(6));
  static_cast<MadeFrames&>(*streams[1]).defect_at = 3;
  ViewStream stream(streams, ViewMaker({{0, {}, kOptions}, {1, {}, kOptions}}), GetParam());
  const std::vector<ViewPtr> views = all_views(stream);
  ASSERT_EQ(views.size(), 6u);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(views[i]->frame, i);
    EXPECT_EQ(views[i]->timestamp, 0.25 * i);
    EXPECT_EQ(views[i]->defect, i == 3 ? "frame of the test is damaged" : "");
    EXPECT_EQ(views[i]->cameras.size(), i == 3 ? 0u : 2u);
  }
}

TEST_P(ViewStreamTest, AFrameThatRepeatsAnotherNamesItAndHasNoImages) {
  OneStream one(12);
  one.source().times_each = 3;
  ViewStream stream(one.streams, ViewMaker({{0, {}, kOptions}}), GetParam());
  const std::vector<ViewPtr> views = all_views(stream);
  ASSERT_EQ(views.size(), 12u);
  for (int i = 0; i < 12; ++i) {
    EXPECT_EQ(views[i]->frame, i);
    EXPECT_EQ(views[i]->timestamp, 0.25 * i);
    EXPECT_EQ(views[i]->same_as, i % 3 == 0 ? -1 : i / 3 * 3) << i;
    EXPECT_EQ(views[i]->cameras.size(), i % 3 == 0 ? 1u : 0u) << i;
  }
  EXPECT_NE(stream.note().find("8 of 12 frames"), std::string::npos) << stream.note();
}

TEST_P(ViewStreamTest, NoFramesAreNoViews) {
  OneStream one(0);
  ViewStream stream(one.streams, ViewMaker({{0, {}, kOptions}}), GetParam());
  EXPECT_TRUE(all_views(stream).empty());
}

// A hang shows as the time limit of the test; the frames read ahead must stay bounded.
TEST_P(ViewStreamTest, MayBeLeftAtAnyTime) {
  constexpr int kFrames = 1000000;
  for (const int taken : {0, 1, 3, 12}) {
    OneStream one(kFrames);
    {
      ViewStream stream(one.streams, ViewMaker({{0, {}, kOptions}}), GetParam());
      for (int i = 0; i < taken; ++i) ASSERT_TRUE(stream.next());
    }
    EXPECT_GE(one.source().made, taken);
    EXPECT_LE(one.source().made, taken + 20);
  }
}

TEST_P(ViewStreamTest, MayBeFinishedEarly) {
  OneStream one(100);
  ViewStream stream(one.streams, ViewMaker({{0, {}, kOptions}}), GetParam());
  ASSERT_TRUE(stream.next());
  EXPECT_GE(stream.finish().count, 1);
  EXPECT_EQ(stream.finish().count, one.source().made) << "a second call tells the same";
}

INSTANTIATE_TEST_SUITE_P(Threads, ViewStreamTest, testing::Values(1, 2, 4));

}  // namespace
}  // namespace raysfm
