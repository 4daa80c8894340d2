#include "raysfm/places/second_looks.h"

#include <gtest/gtest.h>

#include <set>

namespace raysfm {
namespace {

constexpr int kSeen = 20;  // points of a key frame

void see(int keyframe, int track, Map* map) {
  map->observe(track, keyframe, map->keyframes[keyframe].add(0, {1, 2}, 0, track));
}

int new_point(Map* map) {
  const int track = map->new_track();
  map->tracks[track].triangulated = map->tracks[track].had_position = true;
  return track;
}

// A path of `places` places, gone `rounds` times: each key frame sees `kSeen` points, half of which the next
// one sees too. The first `known` of those that it sees first are the points of the round before.
Map rounds(int places, int rounds, int known) {
  Map map;
  std::vector<std::vector<int>> points_of_place(places);
  for (int k = 0; k < places * rounds; ++k) {
    map.keyframes.emplace_back().frame = 3 * k;
    const int place = k % places;
    std::vector<int> points;
    for (int i = 0; i < kSeen / 2; ++i) {
      const bool seen_before = k >= places && i < known;
      points.push_back(seen_before ? points_of_place[place][i] : new_point(&map));
    }
    points_of_place[place] = points;
    for (const int t : points) see(k, t, &map);
    if (place == 0) continue;
    for (const int t : points_of_place[place - 1]) see(k, t, &map);
  }
  return map;
}

// Tracks and features of key frames name each other.
void expect_consistent(const Map& map) {
  const std::set<int> free(map.free_tracks.begin(), map.free_tracks.end());
  for (int t = 0; t < static_cast<int>(map.tracks.size()); ++t) {
    EXPECT_EQ(map.tracks[t].observations.empty(), free.contains(t)) << t;
    for (const TrackObservation& o : map.tracks[t].observations) {
      ASSERT_LT(o.keyframe, static_cast<int>(map.keyframes.size()));
      ASSERT_LT(o.feature, map.keyframes[o.keyframe].size());
      EXPECT_EQ(map.keyframes[o.keyframe].tracks[o.feature], t);
    }
  }
}

TEST(SecondLooks, AreOfPointsThatWereKnownLongBefore) {
  const int places = 30;
  // Of the points of a key frame 0.4 and 0.2 were seen a round before.
  for (const auto& [known, expected] : {std::pair(4, 1), std::pair(2, 0)}) {
    const Map map = rounds(places, 2, known);
    const std::vector<uint8_t> are = second_looks(map, 5, 2 * places, places - 1);
    ASSERT_EQ(are.size(), size_t(2 * places - 5));
    for (int k = 5; k < places; ++k) EXPECT_FALSE(are[k - 5]) << k;
    for (int k = places + 1; k < 2 * places; ++k) EXPECT_EQ(are[k - 5], expected) << k;
  }
  // What is known from a round before was not known more than a round before.
  for (const uint8_t is : second_looks(rounds(places, 2, 4), 0, 2 * places, places)) EXPECT_FALSE(is);
}

TEST(SecondLooks, PointsThatAreNoInliersOrHaveNoPositionDoNotCount) {
  const int places = 30, last = 2 * places - 1;
  Map map = rounds(places, 2, 4);
  const auto is_one = [&] { return second_looks(map, last, last + 1, places - 1)[0]; };
  ASSERT_TRUE(is_one());
  Map as_it_was = map;
  for (const int t : map.keyframes[last].tracks) {
    if (map.tracks[t].observations.front().keyframe < places) map.tracks[t].triangulated = false;
  }
  EXPECT_FALSE(is_one());
  map = as_it_was;
  for (int f = 0; f < map.keyframes[last].size(); ++f) {
    const bool known = map.tracks[map.keyframes[last].tracks[f]].observations.front().keyframe < places;
    map.keyframes[last].inliers[f] = !known;
  }
  EXPECT_FALSE(is_one());
}

// Every fourth key frame of the second round stays.
TEST(SecondLooks, TheMapGoesOnWithoutTheKeyFramesThatGo) {
  const int places = 30, end = places + 20;
  const Map before = rounds(places, 2, 4);
  Map map = before;
  map.guessed_keyframe = end + 2;
  std::vector<uint8_t> goes(end, 0);
  for (int k = places; k < end; ++k) goes[k] = k % 4 != 0;
  const std::vector<int> now = drop_keyframes(goes, &map);
  ASSERT_EQ(now.size(), before.keyframes.size());
  ASSERT_EQ(map.keyframes.size(), before.keyframes.size() - 15);
  EXPECT_EQ(map.guessed_keyframe, end + 2 - 15);
  int stays = -1;
  for (int k = 0; k < static_cast<int>(now.size()); ++k) {
    const bool is_gone = k < end && goes[k];
    EXPECT_EQ(now[k], is_gone ? stays : ++stays);
    if (is_gone) continue;
    EXPECT_EQ(map.keyframes[now[k]].frame, before.keyframes[k].frame);
  }
  expect_consistent(map);

  // What several of those that stay see is seen by these. What one of them sees is gone, unless that is newer
  // than all that go.
  int lost = 0, gone = 0;
  for (size_t t = 0; t < before.tracks.size(); ++t) {
    std::vector<int> left;
    for (const TrackObservation& o : before.tracks[t].observations) {
      if (o.keyframe >= end || !goes[o.keyframe]) left.push_back(now[o.keyframe]);
    }
    const bool stays = left.size() == before.tracks[t].observations.size() || left.size() >= 2;
    EXPECT_EQ(map.tracks[t].triangulated, stays) << t;
    if (!stays && (left.empty() || left[0] <= now[end - 1])) left.clear();
    lost += !stays;
    gone += left.empty();
    ASSERT_EQ(map.tracks[t].observations.size(), left.size());
    for (size_t i = 0; i < left.size(); ++i) EXPECT_EQ(map.tracks[t].observations[i].keyframe, left[i]);
  }
  EXPECT_EQ(static_cast<int>(map.free_tracks.size()), gone);
  EXPECT_GT(gone, 80);
  EXPECT_GT(lost, gone);
}

TEST(SecondLooks, WhereNothingGoesTheMapStaysAsItIs) {
  const Map before = rounds(30, 2, 4);
  Map map = before;
  const std::vector<int> now = drop_keyframes(std::vector<uint8_t>(60, 0), &map);
  for (int k = 0; k < 60; ++k) EXPECT_EQ(now[k], k);
  EXPECT_TRUE(map.free_tracks.empty());
  for (size_t t = 0; t < before.tracks.size(); ++t) {
    EXPECT_EQ(map.tracks[t].observations.size(), before.tracks[t].observations.size());
  }
}

}  // namespace
}  // namespace raysfm
