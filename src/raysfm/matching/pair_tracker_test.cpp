#include "raysfm/matching/pair_tracker.h"

#include <gtest/gtest.h>

#include <cmath>

namespace raysfm {
namespace {

// A band-limited texture, sampled at a shift: the same scene seen by a camera that moves sideways.
ViewPtr shifted_view(int frame, double du, double dv) {
  auto view = std::make_shared<View>();
  view->frame = frame;
  view->cameras.resize(1);
  view->cameras[0].image = GrayImage(320, 240);
  for (int y = 0; y < 240; ++y) {
    for (int x = 0; x < 320; ++x) {
      const double u = x - du, v = y - dv;
      double sum = 0;
      for (int k = 1; k <= 7; ++k) {
        sum += std::sin(0.09 * k * u + 1.7 * k * k) * std::cos(0.083 * k * v + 0.9 * k) / std::sqrt(k);
        sum += 0.6 * std::sin(0.061 * k * (u + v) + 2.3 * k * k);
      }
      view->cameras[0].image.row(y)[x] = static_cast<uint8_t>(std::clamp(128.0 + 22.0 * sum, 0.0, 255.0));
    }
  }
  HarrisDetector detector;
  detect(detector, HarrisOptions{.max_features = 300}, &view->cameras[0]);
  return view;
}

TEST(PairTracker, FollowsCornersThatSpeedUpBeyondTheFirstRegionOfInterest) {
  PairTracker tracker(shifted_view(0, 0, 0), 0);
  double shift = 0;
  for (int k = 1; k <= 6; ++k) {
    shift += 3.0 * k;  // 63 pixels in the end, three times the radius of the first search
    const ViewPtr view = shifted_view(k, shift, 0.2 * shift);
    const int matched = tracker.advance(view);
    EXPECT_GT(matched, 80) << k;
    int right = 0;
    for (int f = 0; f < tracker.base().features.size(); ++f) {
      const int m = tracker.matches(k - 1)[f];
      if (m < 0) continue;
      const Eigen::Vector2f expected =
          tracker.base().features.pixels[f] + Eigen::Vector2f(float(shift), float(0.2 * shift));
      right += (view->cameras[0].features.pixels[m] - expected).norm() < 1.5f;
    }
    EXPECT_GT(right, 0.9 * matched) << k;
    EXPECT_NEAR(tracker.median_displacement(), std::hypot(shift, 0.2 * shift), 0.5);
  }
}

// Stands for all in the number of matches, while what is not followed has none.
TEST(PairTracker, EveryThirdCornerTellsHowManyMatchThereAre) {
  const ViewPtr base = shifted_view(0, 0, 0);
  PairTracker all(base, 0), sample(base, 0, 3);
  for (int k = 1; k <= 6; ++k) {
    const ViewPtr view = shifted_view(k, 3.0 * k, 1.0 * k);
    const int expected = all.advance(view), told = sample.advance(view);
    EXPECT_NEAR(told, expected, 0.15 * expected) << k;
    for (int f = 0; f < base->cameras[0].features.size(); ++f) {
      if (f % 3 != 0) {
        EXPECT_EQ(sample.matches(k - 1)[f], -1);
      }
    }
  }
}

TEST(PairTracker, AStillCameraHasNoDisplacement) {
  PairTracker tracker(shifted_view(0, 0, 0), 0);
  tracker.advance(shifted_view(1, 0, 0));
  EXPECT_LT(tracker.median_displacement(), 0.01f);
}

TEST(PairTracker, AnEmptyViewMatchesNothing) {
  PairTracker tracker(shifted_view(0, 0, 0), 0);
  auto black = std::make_shared<View>();
  black->cameras.resize(1);
  black->cameras[0].image = GrayImage(320, 240);
  for (int y = 0; y < 240; ++y) std::fill_n(black->cameras[0].image.row(y), 320, uint8_t{0});
  HarrisDetector detector;
  detect(detector, HarrisOptions{}, &black->cameras[0]);
  EXPECT_EQ(black->cameras[0].features.size(), 0);
  EXPECT_EQ(tracker.advance(black), 0);
}

}  // namespace
}  // namespace raysfm
