// Rendered films, whose lens is exact, judge what their corners say of it.
#include "raysfm/api/find_lens.h"

#include <gtest/gtest.h>

#include <cmath>

#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

constexpr int kStep = 6, kCount = 16;  // frames from one key frame to the next, and key frames

ViewMaker maker() {
  CameraInput input;
  input.harris.max_features = 1500;
  return ViewMaker({input});
}

// Key frames of a walk through a room, as a map keeps them: without corners.
std::vector<ViewPtr> keyframes_of(const std::string& motion) {
  const SynthViews film = synth_views("room", motion, kStep * kCount);
  std::vector<ViewPtr> views;
  for (int k = 0; k < kCount; ++k) views.push_back(images_of(*film.view(kStep * k, kStep * k)));
  return views;
}

// A run with a camera whose focal length is `factor` times the true one; `told`: the map confirms it, as
// `refined` times the true one.
Reconstruction run_with(double factor, double refined, bool told) {
  const double focal = small_camera().pixels_per_radian();
  Reconstruction r;
  r.rig.cameras = {small_camera()};
  r.calibration.push_back({.camera = 0, .name = "fx", .given = factor * focal, .refined = refined * focal});
  r.calibration[0].told = told;
  return r;
}

class OwnLens : public testing::Test {
 protected:
  static void SetUpTestSuite() { keyframes_ = keyframes_of("look"); }
  static void TearDownTestSuite() { keyframes_.clear(); }
  static std::optional<LensDoubt> doubt(const Reconstruction& r) {
    return doubt_of_lens(r, keyframes_, maker(), 0);
  }

  static std::vector<ViewPtr> keyframes_;
};
std::vector<ViewPtr> OwnLens::keyframes_;

TEST_F(OwnLens, CornersTellTheFocalLength) {
  std::vector<ViewPtr> views;
  for (const ViewPtr& view : keyframes_) views.push_back(maker().detected(view));
  const std::optional<CornerFocal> told = focal_of_corners(views, small_camera(), 0, 0);
  ASSERT_TRUE(told);
  EXPECT_NEAR(told->focal / small_camera().pixels_per_radian(), 1, 0.05);
  EXPECT_GT(told->sigma, 0);
  EXPECT_LT(told->sigma, 0.05);
  EXPECT_FALSE(focal_of_corners(std::span(views).first(4), small_camera(), 0, 0));
}

TEST_F(OwnLens, AWrongLensThatTheMapDoesNotContradictIsDoubted) {
  for (const double factor : {0.7, 1.3, 1.5}) {
    const std::optional<LensDoubt> found = doubt(run_with(factor, factor, false));
    ASSERT_TRUE(found) << factor;
    EXPECT_FALSE(found->refined);
    EXPECT_NEAR(found->seen * factor / found->given, 1, 0.05);
    EXPECT_NE(doubt_warning(*found).find("the footage tells"), std::string::npos);
  }
}

TEST_F(OwnLens, ARightLensIsNot) {
  EXPECT_FALSE(doubt(run_with(1, 1, false)));
  EXPECT_FALSE(doubt(run_with(1.03, 1.03, false)));
  EXPECT_FALSE(doubt(run_with(1.05, 1, true)));
  EXPECT_FALSE(doubt(Reconstruction{}));
}

// What the map tells counts: nothing else is asked.
TEST_F(OwnLens, WhatTheMapTellsCounts) {
  EXPECT_FALSE(doubt(run_with(1.5, 1.5, true)));
  const std::optional<LensDoubt> found = doubt(run_with(1.3, 1, true));
  ASSERT_TRUE(found);
  EXPECT_TRUE(found->refined);
  EXPECT_NE(doubt_warning(*found).find("the map tells"), std::string::npos);
}

TEST_F(OwnLens, LensesThatAreNotPerspectiveAreNotAskedOfCorners) {
  Reconstruction fisheye = run_with(1.5, 1.5, false);
  fisheye.rig.cameras[0].model = KannalaBrandt{};
  EXPECT_FALSE(doubt(fisheye));
}

TEST_F(OwnLens, ACameraThatTurnsTellsNothing) {
  EXPECT_FALSE(doubt_of_lens(run_with(1.5, 1.5, false), keyframes_of("rotate"), maker(), 0));
}

}  // namespace
}  // namespace raysfm
