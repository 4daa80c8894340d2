#include "raysfm/views/dead_features.h"

#include <gtest/gtest.h>

namespace raysfm {
namespace {

// A key frame with ten tracks: every third without a position, every fourth not agreeing with it; all but the
// first two of them described, by their number.
Map map_with_descriptors() {
  Map map;
  MapKeyFrame& k = map.keyframes.emplace_back();
  for (int i = 0; i < 10; ++i) {
    const int track = map.new_track();
    map.tracks[track].triangulated = map.tracks[track].had_position = i % 3 != 0;
    const int feature = k.add(0, {10.0f * static_cast<float>(i), 5}, 0, track);
    map.observe(track, 0, feature);
    k.inliers[feature] = i % 4 != 1;
    if (i < 2) continue;
    k.described.push_back(feature);
    k.descriptors.push_back({{static_cast<uint64_t>(i), 0, 0, 0}});
  }
  return map;
}

// What was told of each feature, by its pixel, is still told of it.
void expect_descriptors_of_their_features(const MapKeyFrame& k, size_t count) {
  ASSERT_EQ(k.described.size(), count);
  ASSERT_EQ(k.descriptors.size(), count);
  for (size_t i = 0; i < count; ++i) {
    ASSERT_LT(k.described[i], k.size());
    EXPECT_EQ(k.pixels[k.described[i]].x(), 10.0f * static_cast<float>(k.descriptors[i].bits[0]));
    if (i > 0) {
      EXPECT_LT(k.described[i - 1], k.described[i]);
    }
  }
}

TEST(DeadFeatures, DescriptorsStayWithTheirFeatures) {
  Map map = map_with_descriptors();
  KeyFrameView view;
  drop_dead_features(0, false, &map, &view);
  EXPECT_EQ(map.keyframes[0].size(), 6);                      // 1, 2, 4, 5, 7, 8
  expect_descriptors_of_their_features(map.keyframes[0], 5);  // all but 1
  drop_dead_features(0, true, &map, &view);
  EXPECT_EQ(map.keyframes[0].size(), 4);  // without 1 and 5
  expect_descriptors_of_their_features(map.keyframes[0], 4);
}

TEST(DeadFeatures, TracksFollowTheirFeatures) {
  Map map = map_with_descriptors();
  KeyFrameView view;
  drop_dead_features(0, true, &map, &view);
  const MapKeyFrame& k = map.keyframes[0];
  for (int f = 0; f < k.size(); ++f) {
    const Track& track = map.tracks[k.tracks[f]];
    ASSERT_EQ(track.observations.size(), 1u);
    EXPECT_EQ(track.observations[0].feature, f);
  }
}

// A key frame that is no place, and one of which nothing is left.
TEST(DeadFeatures, NothingDescribedStaysSo) {
  Map map = map_with_descriptors();
  KeyFrameView view;
  for (Track& t : map.tracks) t.triangulated = false;
  drop_dead_features(0, true, &map, &view);
  expect_descriptors_of_their_features(map.keyframes[0], 0);
  map = map_with_descriptors();
  map.keyframes[0].described.clear();
  map.keyframes[0].descriptors.clear();
  drop_dead_features(0, true, &map, &view);
  expect_descriptors_of_their_features(map.keyframes[0], 0);
}

}  // namespace
}  // namespace raysfm
