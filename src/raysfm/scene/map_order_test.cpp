#include "raysfm/scene/map_order.h"

#include <gtest/gtest.h>

namespace raysfm {
namespace {

// Three key frames in a row; the first point is seen by all, the second by the last two.
Map three_keyframes() {
  Map map;
  map.keyframes.resize(3);
  map.tracks.resize(2);
  for (int k = 0; k < 3; ++k) {
    map.keyframes[k].frame = 10 * k;
    map.keyframes[k].rig_from_world.translation = {-1.0 * k, 0, 0};
    for (int t = 0; t < (k == 0 ? 1 : 2); ++t) map.observe(t, k, map.keyframes[k].add(0, {1, 2}, 0, t));
  }
  return map;
}

std::vector<std::pair<int, int>> seen(const Track& track) {
  std::vector<std::pair<int, int>> seen;
  for (const TrackObservation& o : track.observations) seen.push_back({o.keyframe, o.feature});
  return seen;
}

TEST(MapOrder, KeyFramesAreNumberedTheOtherWayRound) {
  Map map = three_keyframes();
  map.keyframes[2].pixels[1] = {7, 7};
  reverse_keyframes(&map);
  EXPECT_EQ(map.keyframes[0].frame, 20);
  EXPECT_EQ(map.keyframes[2].frame, 0);
  EXPECT_EQ(seen(map.tracks[0]), (std::vector<std::pair<int, int>>{{0, 0}, {1, 0}, {2, 0}}));
  EXPECT_EQ(seen(map.tracks[1]), (std::vector<std::pair<int, int>>{{0, 1}, {1, 1}}));
  EXPECT_EQ(map.keyframes[0].pixels[1].x(), 7);
  EXPECT_EQ(map.guessed_keyframe, -1);
}

TEST(MapOrder, AScaleIsHeldBetweenTheEnds) {
  Map map = three_keyframes();
  map.guessed_keyframe = 1;
  map.guessed_distance = 1;
  reverse_keyframes(&map);
  EXPECT_EQ(map.guessed_keyframe, 2);
  EXPECT_DOUBLE_EQ(map.guessed_distance, 2);
}

}  // namespace
}  // namespace raysfm
