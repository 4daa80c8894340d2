#include "raysfm/views/other_motion.h"

#include <gtest/gtest.h>

#include "support/panel_world.h"

namespace raysfm {
namespace {

constexpr int kSceneWidth = 320, kSceneHeight = 240, kSpacing = 5;

TrackingRig pinhole() {
  Camera camera = testing_support::small_camera();
  camera.width = kSceneWidth;
  camera.height = kSceneHeight;
  return TrackingRig(Rig{{camera}});
}

enum class Corner { kPoint, kOutlier, kFollowed, kSeenOnce, kGivenUp };

// Two key frames; the first has a corner every five pixels, and `kind(u, v)` says what became of it.
template <typename Kind>
Map map_of(Kind kind) {
  Map map;
  map.keyframes.resize(2);
  for (int v = 2; v < kSceneHeight; v += kSpacing) {
    for (int u = 2; u < kSceneWidth; u += kSpacing) {
      const Corner corner = kind(u, v);
      const int track = map.new_track();
      const int feature = map.keyframes[0].add(0, {static_cast<float>(u), static_cast<float>(v)}, 0, track);
      map.observe(track, 0, feature);
      map.tracks[track].triangulated = corner == Corner::kPoint || corner == Corner::kOutlier;
      map.keyframes[0].inliers[feature] = corner != Corner::kOutlier;
      if (corner == Corner::kFollowed) {
        map.observe(track, 1, map.keyframes[1].add(0, {0, 0}, 0, track));
      }
      if (corner == Corner::kGivenUp) map.keyframes[0].tracks[feature] = -1;
    }
  }
  return map;
}

double part_of(const Map& map) {
  return unexplained_part(map, 0, pinhole()).value_or(-1);
}

TEST(OtherMotion, WhatIsAPointOrWasFollowedIsExplained) {
  EXPECT_EQ(part_of(map_of([](int, int) { return Corner::kPoint; })), 0);
  EXPECT_EQ(part_of(map_of([](int, int) { return Corner::kFollowed; })), 0);
  EXPECT_EQ(part_of(map_of([](int, int) { return Corner::kSeenOnce; })), 1);
  EXPECT_EQ(part_of(map_of([](int, int) { return Corner::kGivenUp; })), 1);
  EXPECT_EQ(part_of(map_of([](int, int) { return Corner::kOutlier; })), 1);
}

TEST(OtherMotion, ThePartIsThatOfTheImage) {
  // 16 by 12 cells of 20 pixels: five columns of them are another motion.
  const auto columns = [](int u, int) { return u < 100 ? Corner::kSeenOnce : Corner::kPoint; };
  EXPECT_NEAR(part_of(map_of(columns)), 5.0 / 16, 1e-9);
  // Bad corners between good ones are what every image has.
  const auto mixed = [](int u, int v) {
    return (u / kSpacing + v / kSpacing) % 3 == 0 ? Corner::kPoint : Corner::kSeenOnce;
  };
  EXPECT_EQ(part_of(map_of(mixed)), 0);
}

// A turn by half of what the image shows takes half of it out of sight.
TEST(OtherMotion, WhatLeftTheImageSaysNothing) {
  const auto halves = [](int u, int) { return u < kSceneWidth / 2 ? Corner::kSeenOnce : Corner::kPoint; };
  Map map = map_of(halves);
  EXPECT_NEAR(part_of(map), 0.5, 1e-9);
  Eigen::Vector2d centre(kSceneWidth / 2, kSceneHeight / 2), border(0, kSceneHeight / 2);
  Ray ahead, aside;
  ASSERT_TRUE(pinhole().camera(0).ray(centre, &ahead) && pinhole().camera(0).ray(border, &aside));
  map.keyframes[1].rig_from_world.rotation =
      Eigen::Quaterniond::FromTwoVectors(ahead.direction, aside.direction);
  EXPECT_NEAR(part_of(map), 0, 0.1);
  map.keyframes[1].rig_from_world.rotation = map.keyframes[1].rig_from_world.rotation.conjugate();
  EXPECT_NEAR(part_of(map), 0.5, 0.1);
}

TEST(OtherMotion, FewCornersSayNothing) {
  Map map;
  map.keyframes.resize(1);
  for (int i = 0; i < 100; ++i) {
    const int track = map.new_track();
    map.observe(track, 0, map.keyframes[0].add(0, {static_cast<float>(i % 4), 5}, 0, track));
  }
  EXPECT_FALSE(unexplained_part(map, 0, pinhole()));
}

TEST(MotionWatch, ThreeKeyFramesTogetherAreBelieved) {
  MotionWatch watch;
  for (const auto& [frame, part] : {std::pair(2, 0.1), {4, 0.4}, {6, 0.1}, {8, 0.05}}) watch.add(frame, part);
  EXPECT_TRUE(watch.seen().empty()) << "one key frame alone is nothing";
  for (const auto& [frame, part] : {std::pair(10, 0.5), {12, 0.6}, {14, 0.4}, {16, 0.0}})
    watch.add(frame, part);
  ASSERT_EQ(watch.seen().size(), 1u);
  EXPECT_EQ(watch.seen()[0].first, 8);
  EXPECT_EQ(watch.seen()[0].last, 16);
  EXPECT_NEAR(watch.seen()[0].part, 0.5, 1e-9);
}

TEST(MotionWatch, AShortWorldIsJudgedByWhatItHas) {
  MotionWatch watch;
  watch.add(3, 0.5);
  ASSERT_EQ(watch.seen().size(), 1u);
  watch.restart();
  EXPECT_EQ(watch.seen().size(), 1u);
  watch.add(20, 0.0);
  watch.add(24, 0.3);
  EXPECT_EQ(watch.seen().size(), 1u) << "what was of another world is not counted with it";
  EXPECT_EQ(watch.seen()[0].last, 3);
}

}  // namespace
}  // namespace raysfm
