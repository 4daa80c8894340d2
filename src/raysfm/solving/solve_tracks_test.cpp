#include "raysfm/solving/solve_tracks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "raysfm/api/find_lens.h"
#include "raysfm/core/median.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::labelled;
using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

constexpr int kWidth = 320, kHeight = 240;

// Where a point of the texture is seen in a frame: pixel = scale * point + shift.
struct Place {
  double scale = 1;
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();

  Eigen::Vector2d texture(const Eigen::Vector2d& pixel) const { return (pixel - shift) / scale; }
};

// A band-limited texture, facing the camera; sharp enough for octave 0 until it is enlarged.
GrayImage textured_image(const Place& place) {
  GrayImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const Eigen::Vector2d p = 1.5 * place.texture({x, y});
      double sum = 0;
      for (int k = 1; k <= 7; ++k) {
        sum +=
            std::sin(0.09 * k * p.x() + 1.7 * k * k) * std::cos(0.083 * k * p.y() + 0.9 * k) / std::sqrt(k);
        sum += 0.6 * std::sin(0.061 * k * (p.x() + p.y()) + 2.3 * k * k);
      }
      image.row(y)[x] = static_cast<uint8_t>(std::clamp(128.0 + 22.0 * sum, 0.0, 255.0));
    }
  }
  return image;
}

ViewPtr textured_view(int frame, const Place& place) {
  auto view = std::make_shared<View>();
  view->frame = frame;
  view->timestamp = 0.1 * frame;
  view->name = "frame";
  view->cameras.resize(1);
  view->cameras[0].image = textured_image(place);
  HarrisDetector detector;
  detect(detector, HarrisOptions{.max_features = 300}, &view->cameras[0]);
  return view;
}

// So many frames of the texture, moving to the right.
class TextureSource : public FrameSource {
 public:
  explicit TextureSource(int count) : count_(count) {}

  Result<std::optional<InputFrame>> next() override {
    if (next_ == count_) return std::optional<InputFrame>();
    InputFrame frame;
    frame.index = next_;
    frame.timestamp = 0.1 * next_;
    frame.name = std::to_string(next_);
    frame.gray = textured_image({1, {2.0 * next_++, 0.0}});
    return std::optional<InputFrame>(std::move(frame));
  }
  int width() const override { return kWidth; }
  int height() const override { return kHeight; }
  int frame_count() const override { return count_; }
  std::string description() const override { return "texture"; }

 private:
  int count_, next_ = 0;
};

// How far observations of a track are from its first, on the texture; pixels of the first frame.
struct Drift {
  double median = 0;
  double far = 0;  // share of those off by more than half a pixel: another point that looks alike
};

Drift drift(const PointTracks& tracks, const std::vector<Place>& places) {
  std::map<int, Eigen::Vector2d> first;
  std::vector<double> distances;
  double far = 0;
  for (int k = 0; k < tracks.size(); ++k) {
    const Eigen::Vector2d p = places[tracks.image[k]].texture(tracks.pixel[k]);
    const auto [known, is_first] = first.emplace(tracks.point[k], p);
    if (is_first) continue;
    distances.push_back((p - known->second).norm());
    far += distances.back() > 0.5;
  }
  EXPECT_GT(distances.size(), 2000u);
  far /= double(distances.size());
  return {median_of(&distances), far};
}

SolveInput join(const std::vector<Place>& places) {
  TrackJoiner joiner;
  for (size_t j = 0; j < places.size(); ++j) joiner.add(textured_view(static_cast<int>(j), places[j]));
  return joiner.finish();
}

TEST(TrackJoiner, TracksStayOnTheirPointsWhileTheCameraMovesAside) {
  std::vector<Place> places;
  for (int j = 0; j < 25; ++j) places.push_back({1, {3.3 * j, -0.7 * j}});
  const SolveInput input = join(places);
  ASSERT_EQ(input.keyframe.size(), 25u);
  const Drift d = drift(input.tracks, places);
  EXPECT_LT(d.median, 0.05);
  EXPECT_LT(d.far, 0.05);
  // 16 pixels, a twentieth of the width, make a key frame: five frames of 3.4.
  EXPECT_EQ(input.keyframe[0], 1);
  const auto keyframes = std::count(input.keyframe.begin(), input.keyframe.end(), 1);
  EXPECT_GE(keyframes, 4);
  EXPECT_LE(keyframes, 6);
}

TEST(TrackJoiner, TracksStayOnTheirPointsWhileTheLensZooms) {
  std::vector<Place> places;
  for (int j = 0; j < 25; ++j) {
    const double scale = std::pow(1.02, j);  // to 1.6
    places.push_back({scale, (1 - scale) * Eigen::Vector2d(kWidth / 2, kHeight / 2)});
  }
  const Drift d = drift(join(places).tracks, places);
  EXPECT_LT(d.median, 0.1);
  EXPECT_LT(d.far, 0.05);
}

TEST(TrackJoiner, EveryTrackIsSeenTwiceAndOnceInAnImage) {
  std::vector<Place> places;
  for (int j = 0; j < 12; ++j) places.push_back({1, {6.1 * j, 2.2 * j}});
  const SolveInput input = join(places);
  ASSERT_TRUE(validate(input.tracks).ok());
  ASSERT_EQ(input.rgb.size(), static_cast<size_t>(input.tracks.point_count));
  std::vector<int> seen(input.tracks.point_count, 0);
  std::set<std::pair<int, int>> once;
  for (int k = 0; k < input.tracks.size(); ++k) {
    ++seen[input.tracks.point[k]];
    EXPECT_TRUE(once.emplace(input.tracks.image[k], input.tracks.point[k]).second);
  }
  for (const int count : seen) EXPECT_GE(count, 2);
}

// Inside the label of labelled(), where no patch shows the corridor too.
bool in_label(const Eigen::Vector2d& p) {
  return p.x() > kWidth / 2 + 5 && p.y() < kHeight / 3 - 5;
}

TEST(TrackJoiner, WhatMovesWithTheCameraIsForgotten) {
  const SynthViews plain = synth_views("corridor", "drive", 60), views = labelled(plain);
  TrackJoiner joiner, of_plain;
  for (int i = 0; i < views.size(); ++i) joiner.add(views.view(i, i)), of_plain.add(plain.view(i, i));
  const SolveInput input = joiner.finish(), expected = of_plain.finish();
  ASSERT_TRUE(validate(input.tracks).ok());
  EXPECT_EQ(std::ranges::count_if(input.tracks.pixel, in_label), 0);
  EXPECT_GT(std::ranges::count_if(expected.tracks.pixel, in_label), 1000);
  EXPECT_GT(input.tracks.size(), expected.tracks.size() / 2);
}

// Stretch after stretch, every frame once; each stretch stands alone.
TEST(TrackReader, ReadsStretchByStretch) {
  Input input;
  input.streams.push_back(std::make_unique<TextureSource>(8));
  auto reader = TrackReader::open(std::move(input), 300, 2);
  ASSERT_TRUE(reader);
  const auto until_five = [](const TrackJoiner& joiner) { return joiner.frames() < 5; };
  const std::vector<std::vector<std::string>> names = {{"0", "1", "2", "3", "4"}, {"5", "6", "7"}, {}};
  for (const std::vector<std::string>& expected : names) {
    const Result<SolveInput> stretch = (*reader)->read(until_five);
    ASSERT_TRUE(stretch);
    EXPECT_EQ(stretch->names, expected);
    if (expected.empty()) continue;
    EXPECT_EQ(stretch->keyframe[0], 1);
    EXPECT_GT(stretch->tracks.point_count, 50);
    EXPECT_EQ(stretch->tracks.image_count, static_cast<int>(expected.size()));
    EXPECT_EQ(*std::ranges::min_element(stretch->tracks.image), 0);
  }
}

TEST(TrackJoiner, AFrameThatRepeatsAnotherIsNoFurtherImage) {
  TrackJoiner once, again;
  for (int j = 0; j < 20; ++j) {
    const Place place{1, {3.3 * j, -0.7 * j}};
    once.add(textured_view(j, place));
    again.add(textured_view(3 * j, place));
    for (int k = 1; k < 3; ++k) {
      auto copy = std::make_shared<View>();
      copy->frame = 3 * j + k;
      copy->same_as = 3 * j;
      again.add(copy);
    }
  }
  EXPECT_EQ(again.frames(), 60);
  EXPECT_EQ(again.pictures(), 20);
  const SolveInput a = once.finish(), b = again.finish();
  ASSERT_EQ(b.names.size(), 60u);
  EXPECT_EQ(a.tracks.pixel, b.tracks.pixel);
  EXPECT_EQ(a.tracks.point, b.tracks.point);
  for (int j = 0; j < 60; ++j) EXPECT_EQ(b.original(j), j / 3 * 3) << j;
  for (int k = 0; k < a.tracks.size(); ++k) ASSERT_EQ(b.tracks.image[k], 3 * a.tracks.image[k]) << k;
}

// A walk through a room, every picture several times.
class RepeatedFilm : public FrameSource {
 public:
  RepeatedFilm(const SynthViews& film, int times) : film_(film), times_(times) {}

  Result<std::optional<InputFrame>> next() override {
    if (next_ == frame_count()) return std::optional<InputFrame>();
    InputFrame frame;
    frame.index = next_;
    frame.timestamp = next_ / 30.0;
    const GrayImage& image = film_.images[next_++ / times_];
    frame.gray = GrayImage(image.width(), image.height());
    for (int y = 0; y < image.height(); ++y) std::copy_n(image.row(y), image.width(), frame.gray.row(y));
    return std::optional(std::move(frame));
  }
  int width() const override { return film_.images[0].width(); }
  int height() const override { return film_.images[0].height(); }
  int frame_count() const override { return times_ * film_.size(); }
  std::string description() const override { return "film"; }

 private:
  const SynthViews& film_;
  int times_, next_ = 0;
};

FoundLens lens_of(const SynthViews& film, int times) {
  Input input;
  input.streams.push_back(std::make_unique<RepeatedFilm>(film, times));
  ZoomedStretch zoom;
  TrackSettings settings;
  settings.inputs = {"film"};
  Result<FoundLens> lens = find_lens(settings, std::move(input), {}, &zoom);
  EXPECT_TRUE(lens) << (lens ? "" : lens.error().message);
  return lens ? *std::move(lens) : FoundLens();
}

// Not from a third of the pictures, nor as if there were three times as many.
TEST(FindLens, AFilmThatRepeatsItsFramesTellsWhatItTellsWithout) {
  const SynthViews film = synth_views("room", "look", 240);
  const FoundLens once = lens_of(film, 1), again = lens_of(film, 3);
  EXPECT_EQ(again.origin.focal, once.origin.focal);
  EXPECT_EQ(again.origin.focal_sigma, once.origin.focal_sigma);
  EXPECT_EQ(again.origin.last_frame, 3 * once.origin.last_frame);
  EXPECT_NEAR(again.origin.focal / small_camera().pixels_per_radian(), 1, 0.02);
}

}  // namespace
}  // namespace raysfm
