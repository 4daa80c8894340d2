#include "raysfm/places/loop_closing.h"

#include <gtest/gtest.h>

#include "raysfm/core/random.h"
#include "support/drifted_loop.h"

namespace raysfm {
namespace {

using test::node_on_loop;
using testing_support::normal_vector;

// A camera that goes once round and sees points about it, each from a few key frames in a row, and the map
// that an odometry makes of it whose scale and direction drift.
struct DriftedMap {
  std::vector<Rigid3> truth;  // rig_from_world
  Map map;
  LoopClosure loop;  // the last key frame and the first, as they are in truth
};

constexpr int kKeyFrames = 120;

// Drift about the axis of the circle, which its closure tells; of others half a turn takes back what the
// other half did. x_in_drifted_rig = drift * x_in_true_rig.
std::vector<Similarity3> drifted_nodes(const std::vector<Rigid3>& truth, double scale, double turn) {
  const Similarity3 drift{std::pow(scale, 1.0 / kKeyFrames), exp_so3({0, 0, turn / kKeyFrames}), {0, 0, 0}};
  std::vector<Similarity3> nodes{similarity_of(truth[0])};
  for (int k = 1; k < kKeyFrames; ++k) {
    nodes.push_back(drift * similarity_of(truth[k] * truth[k - 1].inverse()) * nodes.back());
  }
  return nodes;
}

// With a `gap`, nothing is seen from both sides of that key frame's beginning.
DriftedMap drifted_map(double scale, double turn, int gap = -1) {
  DriftedMap out;
  for (int k = 0; k < kKeyFrames; ++k) {
    const Similarity3 node = node_on_loop(k, kKeyFrames);
    out.truth.push_back({node.rotation, node.translation});
  }
  const std::vector<Similarity3> nodes = drifted_nodes(out.truth, scale, turn);
  for (int k = 0; k < kKeyFrames; ++k) {
    MapKeyFrame& keyframe = out.map.keyframes.emplace_back();
    keyframe.frame = 3 * k;
    // A drifted node keeps the true unit in the rig; the map has one unit for all.
    keyframe.rig_from_world = {nodes[k].rotation, nodes[k].translation / nodes[k].scale};
  }
  Rng rng(2);
  for (int begin = -4; begin < kKeyFrames; ++begin) {
    const int first = std::max(begin, 0);
    for (int i = 0; i < 15; ++i) {
      const Eigen::Vector3d in_rig = 5 * normal_vector(rng).normalized();
      const int track = out.map.new_track();
      Track& t = out.map.tracks[track];
      t.triangulated = t.had_position = true;
      t.position = out.map.keyframes[first].rig_from_world.inverse() * (in_rig / nodes[first].scale);
      for (int k = first; k < std::min(begin + 5, kKeyFrames); ++k) {
        if (k == gap && first < gap) break;
        out.map.observe(track, k, out.map.keyframes[k].add(0, Eigen::Vector2f::Zero(), 0, track));
      }
    }
  }
  const Similarity3 true_relation = similarity_of(out.truth[0] * out.truth.back().inverse());
  // Lengths of the map at its end, in those of its beginning.
  const double unit = nodes.back().scale;
  out.loop = {kKeyFrames - 1, 0, true_relation};
  out.loop.there_from_here.scale = unit;
  return out;
}

// Root of the mean square distance of the key frames from where they are; the first is where it is.
double error_of(const DriftedMap& m) {
  double sum = 0;
  for (int k = 0; k < kKeyFrames; ++k) {
    sum += (m.map.keyframes[k].rig_from_world.inverse().translation - m.truth[k].inverse().translation)
               .squaredNorm();
  }
  return std::sqrt(sum / kKeyFrames);
}

Eigen::Vector3d direction(const Map& map, int keyframe, int track) {
  return (map.keyframes[keyframe].rig_from_world * map.tracks[track].position).normalized();
}

// Greatest angle by which points moved in the key frames that see them, of those that are not too near.
double most_moved(const Map& before, const Map& after) {
  double most = 0;
  for (size_t t = 0; t < before.tracks.size(); ++t) {
    for (const TrackObservation& o : before.tracks[t].observations) {
      const int track = static_cast<int>(t);
      if ((before.keyframes[o.keyframe].rig_from_world * before.tracks[t].position).norm() < 3) continue;
      most =
          std::max(most, (direction(before, o.keyframe, track) - direction(after, o.keyframe, track)).norm());
    }
  }
  return most;
}

TEST(LoopClosing, TheDriftGoesAndPointsAreSeenWhereTheyWere) {
  for (const double scale : {0.6, 1.0, 1.8}) {
    for (const double turn : {0.0, 0.5}) {
      if (scale == 1 && turn == 0) continue;
      DriftedMap m = drifted_map(scale, turn);
      const Map before = m.map;
      const double error = error_of(m);
      EXPECT_GT(error, 1);
      close_loop(m.loop, false, &m.map);
      EXPECT_LT(error_of(m), 0.1 * error) << scale << " " << turn;
      EXPECT_LT(most_moved(before, m.map), 0.07) << scale << " " << turn;
    }
  }
}

TEST(LoopClosing, WhatHasNotDriftedStays) {
  DriftedMap m = drifted_map(1, 0);
  const Map before = m.map;
  close_loop(m.loop, false, &m.map);
  EXPECT_LT(error_of(m), 1e-6);
  EXPECT_LT(most_moved(before, m.map), 1e-7);
}

TEST(LoopClosing, TheFirstKeyFrameStaysToTheLastBit) {
  DriftedMap m = drifted_map(1.5, 0.3);
  const Rigid3 before = m.map.keyframes[0].rig_from_world;
  close_loop(m.loop, false, &m.map);
  EXPECT_EQ(m.map.keyframes[0].rig_from_world.translation, before.translation);
  EXPECT_EQ(m.map.keyframes[0].rig_from_world.rotation.coeffs(), before.rotation.coeffs());
}

// Of points that key frames see, from one key frame to the next and from end to end.
TEST(LoopClosing, AKnownScaleStays) {
  DriftedMap m = drifted_map(1, 0.5);
  const Map before = m.map;
  const double error = error_of(m);
  m.loop.there_from_here.scale = 1.3;  // says nothing
  close_loop(m.loop, true, &m.map);
  EXPECT_LT(error_of(m), 0.1 * error);
  for (size_t t = 0; t < before.tracks.size(); ++t) {
    const int k = before.tracks[t].observations[0].keyframe;
    EXPECT_NEAR((m.map.keyframes[k].rig_from_world * m.map.tracks[t].position).norm(),
                (before.keyframes[k].rig_from_world * before.tracks[t].position).norm(), 1e-9);
  }
}

// Where nothing holds the two sides together, the jump is there.
TEST(LoopClosing, AGapTakesTheJump) {
  constexpr int kGap = 60;
  DriftedMap m = drifted_map(1, 0, kGap);
  const Rigid3 jump{exp_so3({0.1, 0.2, -0.1}), {3, -2, 1}};
  for (int k = kGap; k < kKeyFrames; ++k) {
    m.map.keyframes[k].rig_from_world = m.map.keyframes[k].rig_from_world * jump;
  }
  for (Track& t : m.map.tracks) {
    if (t.observations[0].keyframe >= kGap) t.position = jump.inverse() * t.position;
  }
  const double error = error_of(m);
  EXPECT_GT(error, 1);
  close_loop(m.loop, true, &m.map);
  EXPECT_LT(error_of(m), 0.03 * error);
}

// An outlier says nothing of where a point is; one that no key frame sees is nowhere.
TEST(LoopClosing, PointsGoWithAKeyFrameThatAgreesWithThem) {
  DriftedMap m = drifted_map(1.5, 0.3);
  const int last = kKeyFrames - 1;
  // Seen by the first key frame, by mistake, and by the last.
  const int track = m.map.new_track();
  Track& t = m.map.tracks[track];
  t.triangulated = t.had_position = true;
  t.position = m.map.keyframes[last].rig_from_world.inverse() * Eigen::Vector3d(1, 2, 3);
  m.map.observe(track, 0, m.map.keyframes[0].add(0, {0, 0}, 0, track));
  m.map.keyframes[0].inliers.back() = 0;
  m.map.observe(track, last, m.map.keyframes[last].add(0, {0, 0}, 0, track));
  const int unseen = m.map.new_track();
  m.map.tracks[unseen].triangulated = m.map.tracks[unseen].had_position = true;
  const Eigen::Vector3d before = direction(m.map, last, track);
  close_loop(m.loop, false, &m.map);
  EXPECT_LT((direction(m.map, last, track) - before).norm(), 1e-9);
}

}  // namespace
}  // namespace raysfm
