#include "raysfm/places/map_fusion.h"

#include <gtest/gtest.h>

#include <set>

#include "raysfm/core/random.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

Similarity3 random_similarity(Rng& rng) {
  return {std::exp(0.5 * rng.normal()), exp_so3(normal_vector(rng)), 5 * normal_vector(rng)};
}

// Key frames of two cameras at the given frames; tracks that each key frame sees in one of them or both, some
// without a position, some given up.
Map random_map(const std::vector<int>& frames, int tracks, Rng& rng) {
  Map map;
  for (const int frame : frames) {
    MapKeyFrame& k = map.keyframes.emplace_back();
    k.frame = frame;
    k.rig_from_world = {exp_so3(normal_vector(rng)), normal_vector(rng)};
  }
  for (int t = 0; t < tracks; ++t) {
    const int track = map.new_track();
    map.tracks[track].position = 4 * normal_vector(rng);
    map.tracks[track].triangulated = map.tracks[track].had_position = t % 3 != 2;
    for (int k = 0; k < static_cast<int>(frames.size()); ++k) {
      for (int camera = 0; camera < 2; ++camera) {
        if (rng.uniform() < 0.4) continue;
        const Eigen::Vector2f pixel(640 * rng.uniform(), 480 * rng.uniform());
        map.observe(track, k, map.keyframes[k].add(camera, pixel, 0, track));
      }
    }
  }
  // Features without a track, and numbers that may be used again.
  for (MapKeyFrame& k : map.keyframes) k.add(0, {1, 2}, 0, -1);
  for (int i = 0; i < 2; ++i) {
    const int unused = static_cast<int>(map.tracks.size());
    map.tracks.emplace_back();
    map.free_tracks.push_back(unused);
  }
  return map;
}

// Tracks and key frames name each other, in ascending order, each camera of a key frame at most once.
void expect_consistent(const Map& map) {
  for (size_t t = 0; t < map.tracks.size(); ++t) {
    std::set<std::pair<int, int>> seen;
    int newest = -1;
    for (const TrackObservation& o : map.tracks[t].observations) {
      ASSERT_LT(o.keyframe, static_cast<int>(map.keyframes.size()));
      const MapKeyFrame& k = map.keyframes[o.keyframe];
      ASSERT_LT(o.feature, k.size());
      EXPECT_EQ(k.tracks[o.feature], static_cast<int>(t));
      EXPECT_TRUE(seen.insert({o.keyframe, k.cameras[o.feature]}).second);
      EXPECT_GE(o.keyframe, newest);
      newest = o.keyframe;
    }
  }
  for (size_t k = 0; k < map.keyframes.size(); ++k) {
    const MapKeyFrame& keyframe = map.keyframes[k];
    for (int f = 0; f < keyframe.size(); ++f) {
      if (keyframe.tracks[f] < 0) continue;
      int count = 0;
      for (const TrackObservation& o : map.tracks[keyframe.tracks[f]].observations) {
        count += o.keyframe == static_cast<int>(k) && o.feature == f;
      }
      EXPECT_EQ(count, 1) << k << " " << f;
    }
  }
}

// Where a camera at the rig's origin sees a point, whatever the unit of length.
Eigen::Vector3d direction(const MapKeyFrame& k, const Track& t) {
  return (k.rig_from_world * t.position).normalized();
}

void expect_same_views(const Map& before, const Map& after, const std::vector<int>& keyframe_now,
                       int first_track, double scale) {
  for (size_t k = 0; k < before.keyframes.size(); ++k) {
    const MapKeyFrame &was = before.keyframes[k], &is = after.keyframes[keyframe_now[k]];
    EXPECT_EQ(is.frame, was.frame);
    ASSERT_EQ(is.size(), was.size());
    for (int f = 0; f < was.size(); ++f) {
      EXPECT_EQ(is.pixels[f], was.pixels[f]);
      EXPECT_EQ(is.tracks[f], was.tracks[f] < 0 ? -1 : was.tracks[f] + first_track);
      if (was.tracks[f] < 0 || !before.tracks[was.tracks[f]].triangulated) continue;
      const Track &track_was = before.tracks[was.tracks[f]], &track_is = after.tracks[is.tracks[f]];
      ASSERT_TRUE(track_is.triangulated);
      EXPECT_LT((direction(is, track_is) - direction(was, track_was)).norm(), 1e-12);
      EXPECT_NEAR((is.rig_from_world * track_is.position).norm(),
                  scale * (was.rig_from_world * track_was.position).norm(), 1e-10);
    }
  }
}

TEST(MapFusion, JoinedMapsSeeWhatTheySaw) {
  Rng rng(1);
  const Map first = random_map({2, 5, 30, 31}, 40, rng), second = random_map({9, 12, 40}, 30, rng);
  const Similarity3 first_from_second = random_similarity(rng);
  Map joined = first;
  const JoinedNumbers numbers = join_maps(first_from_second, second, &joined);

  EXPECT_EQ(numbers.keyframe_of_first, (std::vector<int>{0, 1, 4, 5}));
  EXPECT_EQ(numbers.keyframe_of_second, (std::vector<int>{2, 3, 6}));
  EXPECT_EQ(numbers.first_track_of_second, static_cast<int>(first.tracks.size()));
  ASSERT_EQ(joined.keyframes.size(), 7u);
  ASSERT_EQ(joined.tracks.size(), first.tracks.size() + second.tracks.size());
  expect_consistent(joined);
  expect_same_views(first, joined, numbers.keyframe_of_first, 0, 1);
  expect_same_views(second, joined, numbers.keyframe_of_second, numbers.first_track_of_second,
                    first_from_second.scale);
  // The first stays where it is; points of the second are where the relation says.
  for (size_t t = 0; t < first.tracks.size(); ++t) {
    EXPECT_EQ(joined.tracks[t].position, first.tracks[t].position);
  }
  for (size_t t = 0; t < second.tracks.size(); ++t) {
    if (!second.tracks[t].triangulated) continue;
    EXPECT_LT(
        (joined.tracks[first.tracks.size() + t].position - first_from_second * second.tracks[t].position)
            .norm(),
        1e-12);
  }
}

TEST(MapFusion, UnusedNumbersOfBothMayBeUsedAgain) {
  Rng rng(2);
  Map first = random_map({0, 1}, 10, rng);
  const Map second = random_map({2, 3}, 10, rng);
  const auto unused = first.free_tracks.size() + second.free_tracks.size();
  join_maps({}, second, &first);
  ASSERT_EQ(first.free_tracks.size(), unused);
  EXPECT_EQ(std::set(first.free_tracks.begin(), first.free_tracks.end()).size(), unused);
  for (const int t : first.free_tracks) {
    ASSERT_LT(t, static_cast<int>(first.tracks.size()));
    EXPECT_TRUE(first.tracks[t].observations.empty());
  }
  for (const MapKeyFrame& k : first.keyframes) {
    for (const int t : k.tracks) EXPECT_EQ(std::ranges::count(first.free_tracks, t), 0);
  }
}

// The first one says what is held of the scale.
TEST(MapFusion, WhatIsKnownOfTheScaleIsThatOfTheFirst) {
  Rng rng(3);
  Map first = random_map({10, 20, 30}, 10, rng), second = random_map({1, 2, 15}, 10, rng);
  first.guessed_keyframe = 2;
  first.guessed_distance = 3.5;
  first.scale_sigma = 0.1;
  first.rescaled = 1.5;
  second.guessed_keyframe = 1;
  second.scale_sigma = 0.001;
  const JoinedNumbers numbers = join_maps(random_similarity(rng), second, &first);
  EXPECT_EQ(first.guessed_keyframe, numbers.keyframe_of_first[2]);
  EXPECT_EQ(first.guessed_keyframe, 5);
  EXPECT_EQ(first.guessed_distance, 3.5);
  EXPECT_EQ(first.scale_sigma, 0.1);
  EXPECT_EQ(first.rescaled, 1.5);
}

TEST(MapFusion, ATransformedMapSeesWhatItSaw) {
  Rng rng(4);
  const Map before = random_map({0, 1, 2}, 30, rng);
  Map after = before;
  after.guessed_distance = 2;
  after.rescaled = 3;
  const Similarity3 b_from_a = random_similarity(rng);
  transform_map(b_from_a, &after);
  expect_same_views(before, after, {0, 1, 2}, 0, b_from_a.scale);
  EXPECT_NEAR(after.guessed_distance, 2 * b_from_a.scale, 1e-12);
  EXPECT_NEAR(after.rescaled, 3 * b_from_a.scale, 1e-12);
  const Eigen::Vector3d center = before.keyframes[1].rig_from_world.inverse().translation;
  EXPECT_LT((after.keyframes[1].rig_from_world.inverse().translation - b_from_a * center).norm(), 1e-10);
}

TEST(MapFusion, OneTrackOfTwoHasAllObservationsOnceInEachCamera) {
  Rng rng(5);
  for (int trial = 0; trial < 20; ++trial) {
    Map map = random_map({0, 3, 6, 9, 12, 15}, 8, rng);
    const Map before = map;
    const int kept = 1 + trial % 3, gone = 4 + trial % 4;
    fuse_tracks(kept, gone, &map);
    expect_consistent(map);
    EXPECT_TRUE(map.tracks[gone].observations.empty());
    EXPECT_FALSE(map.tracks[gone].triangulated);
    // Where either was seen, the one track is; what it saw itself stays.
    const auto seen_in = [](const Map& m, int track) {
      std::set<std::pair<int, int>> seen;
      for (const TrackObservation& o : m.tracks[track].observations) {
        seen.insert({o.keyframe, m.keyframes[o.keyframe].cameras[o.feature]});
      }
      return seen;
    };
    std::set<std::pair<int, int>> expected = seen_in(before, kept);
    expected.merge(seen_in(before, gone));
    EXPECT_EQ(seen_in(map, kept), expected);
    for (const TrackObservation& o : before.tracks[kept].observations) {
      EXPECT_EQ(map.keyframes[o.keyframe].tracks[o.feature], kept);
    }
    // A position, where either had one: that of the kept, or else of the other.
    EXPECT_EQ(map.tracks[kept].triangulated,
              before.tracks[kept].triangulated || before.tracks[gone].triangulated);
    if (map.tracks[kept].triangulated) {
      EXPECT_EQ(map.tracks[kept].position,
                before.tracks[before.tracks[kept].triangulated ? kept : gone].position);
      EXPECT_TRUE(map.tracks[kept].had_position);
    }
    EXPECT_EQ(std::ranges::count(map.free_tracks, gone), 1);
  }
}

TEST(MapFusion, ATrackIsNotFusedWithItself) {
  Rng rng(6);
  Map map = random_map({0, 1, 2}, 5, rng);
  const Map before = map;
  fuse_tracks(2, 2, &map);
  EXPECT_EQ(map.tracks[2].observations.size(), before.tracks[2].observations.size());
  EXPECT_EQ(map.free_tracks, before.free_tracks);
  expect_consistent(map);
}

}  // namespace
}  // namespace raysfm
