// Rendered films, whose lens is exact, judge what their corners say of it.
#include "raysfm/api/find_lens.h"
#include "raysfm/api/given_lens.h"

#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/camera/pixel_finder.h"
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

// A rig of such cameras, one of each focal length: parts of the true one.
Rig rig_of(const std::vector<double>& factors) {
  Rig rig;
  for (const double factor : factors) {
    Camera camera = small_camera();
    auto& model = std::get<Radtan>(camera.model);
    model.fx *= factor, model.fy *= factor;
    rig.cameras.push_back(camera);
  }
  return rig;
}

// A run with cameras whose focal lengths are `given` times the true one and end at `refined` times; `told`:
// the map confirms it.
Reconstruction run_with(const std::vector<double>& given, const std::vector<double>& refined, bool told) {
  const double focal = small_camera().pixels_per_radian();
  Reconstruction r;
  r.rig = rig_of(refined);
  for (size_t c = 0; c < given.size(); ++c) {
    r.calibration.push_back({.camera = static_cast<int>(c),
                             .name = "fx",
                             .given = given[c] * focal,
                             .refined = refined[c] * focal,
                             .told = told});
  }
  r.frames.emplace_back().world_from_rig = Rigid3{};
  r.keyframes.push_back({});
  return r;
}

// As many points seen by a camera, each that far from where the map has it.
void see(int camera, int points, double off, Reconstruction* r) {
  for (int i = 0; i < points; ++i) {
    const Eigen::Vector3d point(0.01 * i, 0, 5);
    Eigen::Vector2d pixel;
    ASSERT_TRUE(PixelFinder(r->rig.cameras[camera]).find(point, &pixel));
    r->observations.push_back({static_cast<int>(r->points.size()), camera, pixel + Eigen::Vector2d(0, off)});
    r->points.push_back({.position = point});
  }
  r->keyframes[0].last_observation = static_cast<int>(r->observations.size());
}

// Of one camera, whose map explains well what it sees.
Reconstruction run_with(double given, double refined, bool told) {
  Reconstruction r = run_with(std::vector{given}, std::vector{refined}, told);
  r.rig.cameras = {small_camera()};  // whose distortion is that of the images
  see(0, 20, 0.2, &r);
  return r;
}

class OwnLens : public testing::Test {
 protected:
  static void SetUpTestSuite() { keyframes_ = keyframes_of("look"); }
  static void TearDownTestSuite() { keyframes_.clear(); }
  static std::vector<LensDoubt> doubts(const Reconstruction& r, const std::vector<ViewPtr>& keyframes) {
    return doubts_of_lenses(r, keyframes, TrackingRig(r.rig), maker(), 0);
  }
  static std::vector<LensDoubt> doubts(const Reconstruction& r) { return doubts(r, keyframes_); }

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

using By = LensDoubt::By;

TEST_F(OwnLens, AWrongLensThatTheMapDoesNotContradictIsDoubted) {
  for (const double factor : {0.7, 1.3, 1.5}) {
    const std::vector<LensDoubt> found = doubts(run_with(factor, factor, false));
    ASSERT_EQ(found.size(), 1U) << factor;
    EXPECT_EQ(found[0].by, By::kCorners);
    EXPECT_NEAR(found[0].seen * factor / found[0].given, 1, 0.05);
    EXPECT_NE(doubt_warning(found, 1).find("the footage tells"), std::string::npos);
  }
}

TEST_F(OwnLens, ARightLensIsNot) {
  EXPECT_TRUE(doubts(run_with(1, 1, false)).empty());
  EXPECT_TRUE(doubts(run_with(1.03, 1.03, false)).empty());
  EXPECT_TRUE(doubts(run_with(1.05, 1, true)).empty());
  Reconstruction nothing;
  nothing.rig = rig_of({1});
  EXPECT_TRUE(doubts(nothing).empty());
}

// What the map tells counts: nothing else is asked.
TEST_F(OwnLens, WhatTheMapTellsCounts) {
  EXPECT_TRUE(doubts(run_with(1.5, 1.5, true)).empty());
  const std::vector<LensDoubt> found = doubts(run_with(1.3, 1, true));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].by, By::kMap);
  EXPECT_NE(doubt_warning(found, 1).find("the map tells"), std::string::npos);
}

// Corners that say the given one count for more than residuals, which noise makes large too.
TEST_F(OwnLens, ARightLensIsNotDoubtedForLargeResiduals) {
  Reconstruction noisy = run_with(std::vector{1.0}, std::vector{1.0}, false);
  see(0, 20, 1.2, &noisy);
  EXPECT_TRUE(doubts(noisy).empty());
}

TEST_F(OwnLens, LensesThatAreNotPerspectiveAreNotAskedOfCornersButOfResiduals) {
  for (const double off : {0.3, 1.2}) {
    Reconstruction fisheye = run_with(std::vector{1.5}, std::vector{1.5}, false);
    const double focal = 1.5 * small_camera().pixels_per_radian();
    fisheye.rig.cameras[0].model = KannalaBrandt{focal, focal, 100, 75};
    see(0, 20, off, &fisheye);
    const std::vector<LensDoubt> found = doubts(fisheye);
    ASSERT_EQ(found.size(), off > 1 ? 1U : 0U) << off;
    for (const LensDoubt& doubt : found) {
      EXPECT_EQ(doubt.by, By::kMisfit);
      EXPECT_NEAR(doubt.rms, off, 1e-5);
    }
  }
}

TEST_F(OwnLens, ACameraThatTurnsTellsNothing) {
  const Reconstruction r = run_with(1.5, 1.5, false);
  EXPECT_TRUE(doubts(r, keyframes_of("rotate")).empty());
}

// Of films that corners tell nothing of. Every camera of a rig is asked, but for those that the map has no
// trouble with.
TEST_F(OwnLens, CamerasOfARigAreDoubtedOneByOne) {
  for (const int bad : {1, 2}) {
    Reconstruction r = run_with({1, 1, 1}, {1, 1, 1}, true);
    for (const int c : {0, 1, 2}) see(c, 20, c == bad ? 1.2 : 0.2, &r);
    EXPECT_TRUE(doubts(r, {}).empty()) << "told by the map";
    r.calibration[bad].told = false;
    const std::vector<LensDoubt> found = doubts(r, {});
    ASSERT_EQ(found.size(), 1U);
    EXPECT_EQ(found[0].camera, bad);
    EXPECT_EQ(found[0].by, By::kMisfit);
    EXPECT_NE(doubt_warning(found, 3).find("camera " + std::to_string(bad)), std::string::npos);
  }
}

TEST_F(OwnLens, ACameraOfWhichLittleFitsIsDoubtedToo) {
  for (const int fit : {2, 15}) {
    Reconstruction r = run_with({1, 1, 1}, {1, 1, 1}, false);
    r.calibration[0].told = true;
    for (const int c : {0, 1, 2}) see(c, c == 2 ? fit : 20, 0.2, &r);
    EXPECT_EQ(doubts(r, {}).size(), fit == 2 ? 1U : 0U) << fit;
  }
}

// Two cameras side by side that look at the same wall, each at points of its own, or at those of the other.
TEST_F(OwnLens, CamerasThatShouldSeeTheSameAndDoNotAreDoubted) {
  for (const bool is_shared : {true, false}) {
    Reconstruction r = run_with({1, 1}, {1, 1}, true);
    r.rig.cameras[1].rig_from_cam.translation = {0.4, 0, 0};
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3d point(0.003 * i, 0, 5);
      r.points.push_back({.position = point});
      for (const int c : {0, 1}) {
        Eigen::Vector2d pixel;
        const Camera& camera = r.rig.cameras[c];
        ASSERT_TRUE(PixelFinder(camera).find(camera.rig_from_cam.inverse() * point, &pixel));
        if (is_shared || c == i % 2) r.observations.push_back({i, c, pixel});
      }
    }
    r.keyframes[0].last_observation = static_cast<int>(r.observations.size());
    const std::vector<LensDoubt> found = doubts(r, {});
    ASSERT_EQ(found.size(), is_shared ? 0U : 2U);
    for (const LensDoubt& doubt : found) EXPECT_EQ(doubt.by, By::kApart);
  }
}

}  // namespace
}  // namespace raysfm
