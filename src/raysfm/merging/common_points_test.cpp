#include "raysfm/merging/common_points.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "raysfm/geometry/similarity.h"

namespace raysfm {
namespace {

constexpr int kPoints = 400, kDecoys = 100;

Camera camera_of(double factor) {
  Camera camera;
  camera.model = Pinhole{factor * 300, factor * 300, 159.5, 119.5};
  camera.width = 320, camera.height = 240;
  return camera;
}

// A camera that goes sideways past points. Those after kPoints are behind others of them, as the first frame
// sees it.
std::vector<Eigen::Vector3d> scene() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> side(-4, 8), height(-2, 2), depth(5, 9);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < kPoints; ++i) points.push_back({side(random), height(random), depth(random)});
  for (int i = 0; i < kDecoys; ++i) points.push_back(1.5 * points[i]);
  return points;
}

Rigid3 rig_from_world(int frame) {
  return {Eigen::Quaterniond::Identity(), {-0.2 * frame, 0, 0}};
}

// What a run makes of the scene that has these frames as key frames, in a world of its own; every pixel is
// off by a fifth of one. Track t is point t, or kPoints + kDecoys - 1 - t where they are counted from behind.
Map map_of(std::span<const int> frames, const Similarity3& own_from_world, bool from_behind, int seed) {
  const TrackingRig rig(Rig{{camera_of(1)}});
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 0.2);
  const std::vector<Eigen::Vector3d> points = scene();
  const int count = static_cast<int>(points.size());
  Map map;
  for (int t = 0; t < count; ++t) {
    Track& track = map.tracks[map.new_track()];
    track.position = own_from_world * points[from_behind ? count - 1 - t : t];
    track.triangulated = true;
  }
  for (const int frame : frames) {
    MapKeyFrame& k = map.keyframes.emplace_back();
    k.frame = frame;
    k.rig_from_world = carried_over(rig_from_world(frame), own_from_world);
    for (int t = 0; t < count; ++t) {
      Eigen::Vector2d pixel;
      if (!rig.see(0, k.rig_from_world * map.tracks[t].position, &pixel)) continue;
      const Eigen::Vector2d seen = pixel + Eigen::Vector2d(noise(random), noise(random));
      map.observe(t, static_cast<int>(map.keyframes.size()) - 1, k.add(0, seen.cast<float>(), 0, t));
    }
  }
  return map;
}

std::vector<KnownPose> known(std::span<const int> frames, const Similarity3& other_from_world) {
  std::vector<KnownPose> poses;
  for (int k = 0; k < static_cast<int>(frames.size()); ++k)
    poses.push_back({k, carried_over(rig_from_world(frames[k]), other_from_world)});
  return poses;
}

// Two runs that have no key frame in common, each in its own frame and unit.
TEST(CommonPoints, AreFoundByTheImagesThatBothHaveSeen) {
  const std::vector<int> of_a = {0, 4, 8, 12, 16}, of_b = {1, 6, 11, 15, 19};
  const Similarity3 a_from_world,
      b_from_world{
          2.5, Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized())), {4, 5, 6}};
  const Map a = map_of(of_a, a_from_world, false, 2), b = map_of(of_b, b_from_world, true, 3);
  const TrackingRig rig(Rig{{camera_of(1)}});
  const std::vector<KnownPose> known_a = known(of_a, b_from_world), known_b = known(of_b, a_from_world);
  const std::vector<CommonPoint> common = find_common_points({rig, a, known_a}, {rig, b, known_b});
  std::set<int> found;
  for (const CommonPoint& p : common) {
    const int in_a = a.keyframes[p.of_a.keyframe].tracks[p.of_a.feature];
    const int in_b = b.keyframes[p.of_b.keyframe].tracks[p.of_b.feature];
    EXPECT_EQ(in_a, kPoints + kDecoys - 1 - in_b);
    EXPECT_TRUE(found.insert(in_a).second) << in_a;
  }
  int seen = 0;  // by three key frames at least
  for (int t = 0; t < kPoints + kDecoys; ++t)
    seen += a.tracks[t].observations.size() + b.tracks[kPoints + kDecoys - 1 - t].observations.size() >= 3;
  EXPECT_GT(common.size(), 0.9 * seen);
}

// Images that were not the same show nothing in common.
TEST(CommonPoints, WrongPosesHaveNone) {
  const std::vector<int> frames = {0, 4, 8, 12, 16}, others = {2, 6, 10, 14, 18};
  const Map a = map_of(frames, {}, false, 2), b = map_of(frames, {}, true, 3);
  const TrackingRig rig(Rig{{camera_of(1)}});
  const std::vector<KnownPose> wrong = known(others, {});
  EXPECT_LT(find_common_points({rig, a, wrong}, {rig, b, wrong}).size(), 10u);
  EXPECT_TRUE(find_common_points({rig, a, {}}, {rig, b, {}}).empty());
}

}  // namespace
}  // namespace raysfm
