#include "raysfm/views/fixed_marks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <utility>

#include "support/panel_world.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::as_view;
using testing_support::render;
using testing_support::Texture;

constexpr int kFilmWidth = 320, kFilmHeight = 240, kFilmFrames = 80;
// Of what is laid over the film.
constexpr int kLeft = 200, kTop = 20, kRight = 300, kBottom = 80;
constexpr float kRim = 5;  // pixels: patches nearer to its edge show the wall too

bool on_label(const Eigen::Vector2f& p, float margin = 0) {
  return p.x() >= kLeft - margin && p.x() <= kRight + margin && p.y() >= kTop - margin &&
         p.y() <= kBottom + margin;
}

// Films show the same walls.
const GrayImage& wall_that_moved(const Eigen::Vector2d& moved) {
  static const Texture wall(4, 6, 30, 40);
  static std::map<std::pair<double, double>, GrayImage> rendered;
  GrayImage& image = rendered[{moved.x(), moved.y()}];
  if (image.empty()) {
    image = render(wall, kFilmWidth, kFilmHeight,
                   [&](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p + moved; });
  }
  return image;
}

// A wall that has moved so far, with a label in front that stays.
GrayImage labelled_image(const Eigen::Vector2d& moved, bool has_label) {
  static const GrayImage label = render(Texture(9, 5, 20, 50), kFilmWidth, kFilmHeight,
                                        [](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p; });
  const GrayImage& wall = wall_that_moved(moved);
  GrayImage image(kFilmWidth, kFilmHeight);
  for (int y = 0; y < kFilmHeight; ++y) std::copy_n(wall.row(y), kFilmWidth, image.row(y));
  for (int y = kTop; has_label && y <= kBottom; ++y) {
    std::copy_n(label.row(y) + kLeft, kRight - kLeft + 1, image.row(y) + kLeft);
  }
  return image;
}

ViewPtr labelled_wall(const Eigen::Vector2d& moved, int frame, bool has_label = true) {
  return as_view(labelled_image(moved, has_label), frame);
}

// All of a film whose wall moves by so much from frame to frame.
FixedMarks watched(const Eigen::Vector2d& step, bool has_label) {
  FixedMarks marks;
  for (int i = 0; i < kFilmFrames; ++i) marks.watch(*labelled_wall(i * step, i, has_label));
  return marks;
}

TEST(FixedMarks, WhatStaysInItsPlaceIsLeftOut) {
  const FixedMarks marks = watched({4, 1}, true);
  const ViewPtr whole = labelled_wall({500, 100}, kFilmFrames);
  const ViewPtr rest = marks.without(whole);
  int on_label_before = 0, on_label_after = 0, elsewhere_before = 0, elsewhere_after = 0;
  const float reach = 0.025f * kFilmWidth;
  for (const Eigen::Vector2f& p : whole->cameras[0].features.pixels) {
    on_label_before += on_label(p);
    elsewhere_before += !on_label(p, reach);
  }
  const CameraView& left = rest->cameras[0];
  for (const Eigen::Vector2f& p : left.features.pixels) {
    on_label_after += on_label(p, -kRim);
    elsewhere_after += !on_label(p, reach);
  }
  ASSERT_GT(on_label_before, 40);
  EXPECT_EQ(on_label_after, 0);
  EXPECT_EQ(elsewhere_after, elsewhere_before);
  EXPECT_NEAR(marks.part_of(*whole), 100.0 * 60 / (kFilmWidth * kFilmHeight), 0.06);
  EXPECT_EQ(left.patches.size(), left.features.size());
  EXPECT_EQ(std::ssize(left.rgb), left.features.size());
  int in_grids = 0;
  for (const FeatureGrid& grid : left.grids) in_grids += grid.size();
  EXPECT_EQ(in_grids, left.features.size());
}

TEST(FixedMarks, NothingIsLeftOutWhereAllMovesOrAllStands) {
  EXPECT_TRUE(watched({4, 1}, false).empty());
  EXPECT_TRUE(watched({0, 0}, true).empty()) << "a camera that stands sees nothing move";
  EXPECT_TRUE(watched({0.02, 0}, true).empty()) << "nearly";
}

// Compression draws a part of what is laid over a film anew, time and again.
TEST(FixedMarks, GoOnWhereTheyAreSeenLessOften) {
  constexpr int kFrames = 44, kFrom = 240, kTo = 275;  // columns, as they were in half of the frames
  const GrayImage other = render(Texture(13, 5, 20, 50), kFilmWidth, kFilmHeight,
                                 [](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p; });
  FixedMarks marks;
  for (int i = 0; i < kFrames; ++i) {
    GrayImage image = labelled_image(i * Eigen::Vector2d(4, 1), true);
    for (int y = kTop; i / 2 % 2 == 1 && y <= kBottom; ++y)
      std::copy_n(other.row(y) + kFrom, kTo - kFrom, image.row(y) + kFrom);
    marks.watch(*as_view(std::move(image), i));
  }
  const ViewPtr rest = marks.without(labelled_wall({500, 100}, kFilmFrames));
  const CameraView& left = rest->cameras[0];
  const auto on_rest = [](const Eigen::Vector2f& p) {
    return on_label(p, -kRim) && p.x() > kFrom + kRim && p.x() < kTo - kRim;
  };
  EXPECT_EQ(std::ranges::count_if(left.features.pixels, on_rest), 0);
  EXPECT_GT(left.features.size(), 100);
}

constexpr int kRound = 20;  // frames, each a step

// A wall that moves by so much from frame to frame, behind something that stays where `in_front` says so.
template <typename InFront>
GrayImage image_behind(int width, int height, int frame, const InFront& in_front) {
  static const Texture wall(4, 6, 30, 40), front(9, 4, 8, 50);
  static GrayImage still;
  if (still.width() != width) {
    still = render(front, width, height, [](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p; });
  }
  const Eigen::Vector2d moved = frame * Eigen::Vector2d(15, 5);
  GrayImage image =
      render(wall, width, height, [&](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p + moved; });
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (in_front(x, y)) image.row(y)[x] = still.row(y)[x];
    }
  }
  return image;
}

template <typename InFront>
ViewPtr wall_behind(int width, int height, int frame, const InFront& in_front) {
  return as_view(image_behind(width, height, frame, in_front), frame, 1500);
}

// A dashboard takes more of the corners than of a wide image.
TEST(FixedMarks, ManyCornersInOnePlaceCountNoMoreThanFewInAnother) {
  constexpr int kDashboard = 140, kWide = 640, kLow = 192;
  const auto in_front = [](int, int y) { return y >= kDashboard; };
  FixedMarks marks;
  for (int i = 0; i < kRound; ++i) marks.watch(*wall_behind(kWide, kLow, i, in_front));
  const ViewPtr whole = wall_behind(kWide, kLow, kRound, in_front), rest = marks.without(whole);
  const auto on_dashboard = [](const ViewPtr& view) {
    return std::ranges::count_if(view->cameras[0].features.pixels,
                                 [](const Eigen::Vector2f& p) { return p.y() >= kDashboard + kRim; });
  };
  ASSERT_GT(on_dashboard(whole), 100);
  EXPECT_EQ(on_dashboard(rest), 0);
  EXPECT_GT(rest->cameras[0].features.size(), 100);
}

// What has stayed for a while is not asked whether the rest moves, of which there may be little to see.
TEST(FixedMarks, AreFoundWhereTheyHaveMostOfTheImagesCorners) {
  constexpr int kDashboard = 150, kSky = 60, kClear = 6;  // rows, and frames without a fog
  FixedMarks marks;
  for (int i = 0; i < 2 * kRound; ++i) {
    GrayImage image = image_behind(kFilmWidth, kFilmHeight, i, [](int, int y) { return y >= kDashboard; });
    for (int y = kSky; i >= kClear && y < kDashboard; ++y)
      std::fill_n(image.row(y), kFilmWidth, uint8_t{128});
    marks.watch(*as_view(std::move(image), i, 1500));
  }
  EXPECT_FALSE(marks.empty());
  EXPECT_TRUE(marks.covers(0, {160, 200}));
  EXPECT_FALSE(marks.covers(0, {160, 30}));
}

// People who walk before a camera that stands may hide half of the image, each part of it for a fifth of the
// time.
TEST(FixedMarks, WhereMostOfTheImageStaysTheCameraStands) {
  FixedMarks marks;
  for (int i = 0; i < kRound; ++i) {
    marks.watch(*wall_behind(kFilmWidth, kFilmHeight, i, [&](int x, int) {
      const int column = x / 40;
      return column >= 3 && (column + i) % 5 != 0;
    }));
  }
  EXPECT_TRUE(marks.empty());
}

TEST(FixedMarks, HoldFromTheFrameOnThatTheyWereFoundIn) {
  FixedMarks marks;
  int found = -1;
  for (int i = 0; i < kFilmFrames && found < 0; ++i) {
    if (marks.watch(*labelled_wall({4.0 * i, 0}, i))) found = i;
  }
  ASSERT_GT(found, 5);
  const ViewPtr before = labelled_wall({0, 0}, found - 1);
  EXPECT_EQ(marks.without(before), before);
  EXPECT_LT(marks.without(labelled_wall({0, 0}, found))->cameras[0].features.size(),
            before->cameras[0].features.size());
  marks.hold_from(0);
  EXPECT_NE(marks.without(before), before);
}

}  // namespace
}  // namespace raysfm
