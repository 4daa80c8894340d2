#include "raysfm/mapping/relief.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <variant>

#include "raysfm/mapping/planar_twin.h"
#include "support/narrow_scene.h"

namespace raysfm {
namespace {

using testing_support::map_of;
using testing_support::NarrowScene;

TEST(Relief, ANarrowerLensTellsLessOfTwo) {
  double before = 1e9;
  for (const double fov : {40.0, 20.0, 10.0, 5.0}) {
    const NarrowScene scene(fov);
    NarrowScene reversed = scene;
    reversed.reverse();
    const double apart = scene.apart(reversed);
    EXPECT_LT(apart, 0.6 * before) << fov;
    before = apart;
    // The one is not the other: what was near is far.
    const double depth = scene.points[0].z() - scene.camera.pixels_per_radian() / NarrowScene::kSide;
    const double other = reversed.points[0].z() - scene.camera.pixels_per_radian() / NarrowScene::kSide;
    EXPECT_LT(depth * other, 0);
  }
  EXPECT_LT(before, 0.3);
}

TEST(Relief, TheFirstPoseAndItsDirectionsStay) {
  const NarrowScene scene(30);
  NarrowScene reversed = scene;
  reversed.reverse();
  EXPECT_LT(reversed.cam_from_world[0].rotation.angularDistance(scene.cam_from_world[0].rotation), 1e-12);
  EXPECT_LT((reversed.cam_from_world[0].translation - scene.cam_from_world[0].translation).norm(), 1e-12);
  for (size_t i = 0; i < scene.points.size(); ++i) {
    EXPECT_LT((reversed.points[i].normalized() - scene.points[i].normalized()).norm(), 1e-12);
  }
}

TEST(Relief, TwiceIsAsItWas) {
  const NarrowScene scene(30);
  NarrowScene twice = scene;
  twice.reverse();
  twice.reverse();
  for (size_t k = 0; k < scene.cam_from_world.size(); ++k) {
    EXPECT_LT(twice.cam_from_world[k].rotation.angularDistance(scene.cam_from_world[k].rotation), 1e-9);
    EXPECT_LT((twice.cam_from_world[k].translation - scene.cam_from_world[k].translation).norm(), 1e-9);
  }
  for (size_t i = 0; i < scene.points.size(); ++i) {
    EXPECT_LT((twice.points[i] - scene.points[i]).norm(), 1e-9);
  }
}

// Largest error of a rotation between a key frame and the first, radians.
double worst_rotation(const Map& map, const NarrowScene& truth) {
  double worst = 0;
  for (size_t k = 0; k < map.keyframes.size(); ++k) {
    worst = std::max(
        worst, map.keyframes[k].rig_from_world.rotation.angularDistance(truth.cam_from_world[k].rotation));
  }
  return worst;
}

// Holds the map of a scene that is believed to be its rival against that scene.
void expect_turned(const NarrowScene& scene, const NarrowScene& rival) {
  const TrackingRig rig(Rig{{scene.camera}});
  const OdometryOptions options;
  Mapper mapper(rig, options);
  Map map = map_of(rig, scene, rival);
  mapper.adjust_globally(&map);
  ASSERT_GT(worst_rotation(map, scene), 0.05) << "adjusting is enough";
  EXPECT_EQ(mapper.choose_relief(&map), Relief::kReversed);
  EXPECT_LT(worst_rotation(map, scene), 0.01);
  EXPECT_NE(mapper.choose_relief(&map), Relief::kReversed);
}

class ReliefOfMapTest : public testing::TestWithParam<double> {};

TEST_P(ReliefOfMapTest, AMapInsideOutIsTurned) {
  const NarrowScene scene(GetParam());
  NarrowScene reversed = scene;
  reversed.reverse();
  expect_turned(scene, reversed);
}

TEST_P(ReliefOfMapTest, TheRightMapStays) {
  const NarrowScene scene(GetParam());
  const TrackingRig rig(Rig{{scene.camera}});
  const OdometryOptions options;
  Mapper mapper(rig, options);
  Map map = map_of(rig, scene, scene);
  mapper.adjust_globally(&map);
  const Map before = map;
  EXPECT_NE(mapper.choose_relief(&map), Relief::kReversed);
  for (size_t k = 0; k < map.keyframes.size(); ++k) {
    EXPECT_EQ(map.keyframes[k].rig_from_world.rotation.coeffs(),
              before.keyframes[k].rig_from_world.rotation.coeffs());
    EXPECT_EQ(map.keyframes[k].inliers, before.keyframes[k].inliers);
  }
  for (size_t i = 0; i < map.tracks.size(); ++i) EXPECT_EQ(map.tracks[i].position, before.tracks[i].position);
}

// Another lens moves all that a narrow one sees by more than an inlier may be off.
TEST_P(ReliefOfMapTest, AMapFollowsAnotherLensWithAllItsPoints) {
  NarrowScene scene(GetParam());
  const TrackingRig rig(Rig{{scene.camera}});
  const Map seen = map_of(rig, scene, scene);
  auto& lens = std::get<Pinhole>(scene.camera.model);
  lens.fy *= 1.1, lens.cx += 40, lens.cy -= 30;
  const TrackingRig other(Rig{{scene.camera}});
  const OdometryOptions options;
  Mapper mapper(other, options);
  for (const Adaption how : {Adaption::kThinned, Adaption::kTwoSeriesThinned, Adaption::kTwoSeries}) {
    Map map = seen;
    mapper.adapt_to_cameras(0, how, &map);
    const auto is_there = [](const Track& track) { return track.triangulated; };
    EXPECT_GT(std::ranges::count_if(map.tracks, is_there), 190);
  }
}

// A poster with a few things that stand out from it, passed in a straight line.
NarrowScene poster() {
  NarrowScene scene(40);
  Rng rng(11);
  const auto uniform = [&] { return 2 * rng.uniform() - 1; };
  const Eigen::Vector3d plane = Eigen::Vector3d(0.1, -0.25, 1) / 3;
  for (size_t i = 0; i < scene.points.size(); ++i) {
    const Eigen::Vector3d ray(0.3 * uniform(), 0.3 * uniform(), 1);
    scene.points[i] = ray * ((i % 8 == 0 ? 0.95 : 1) / plane.dot(ray));
  }
  const Eigen::Vector3d way = Eigen::Vector3d(-0.4, 0.7, 1).normalized();
  for (size_t k = 0; k < scene.cam_from_world.size(); ++k) {
    const auto part = static_cast<double>(k);
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.04 * part, Eigen::Vector3d(0.8, 0.5, 0).normalized()));
    scene.cam_from_world[k] = {turn, turn * (-0.1 * part * way)};
  }
  return scene;
}

TEST(Relief, AMapOfTheTwinOfAPlaneIsTurned) {
  const NarrowScene scene = poster();
  NarrowScene twin = scene;
  ASSERT_TRUE(take_planar_twin(twin.cam_from_world, twin.points));
  expect_turned(scene, twin);
}

// Root mean square of the reprojection errors of a map's observations, pixels.
double rms_error(const Map& map, const Camera& camera) {
  double sum = 0;
  int count = 0;
  for (const MapKeyFrame& k : map.keyframes) {
    for (int f = 0; f < k.size(); ++f) {
      const Track& track = map.tracks[k.tracks[f]];
      Eigen::Vector2d pixel;
      if (!track.triangulated || !camera.project(k.rig_from_world * track.position, &pixel)) continue;
      sum += (pixel - k.pixels[f].cast<double>()).squaredNorm();
      ++count;
    }
  }
  return std::sqrt(sum / count);
}

// Rows of each key frame move by another way, as where a readout was found. Steps of little damping go too
// far there.
TEST(Adaption, AFewStepsFollowRowsThatMoved) {
  for (const double fov : {15.0, 30.0}) {
    const NarrowScene scene(fov, 8);
    const TrackingRig rig(Rig{{scene.camera}});
    const OdometryOptions options;
    Mapper mapper(rig, options);
    Map map = map_of(rig, scene, scene);
    mapper.adjust_globally(&map);
    Rng rng(9);
    for (MapKeyFrame& k : map.keyframes) {
      const Eigen::Vector2f shear = 8 * Eigen::Vector2d(rng.normal(), rng.normal()).cast<float>();
      for (Eigen::Vector2f& pixel : k.pixels) pixel += (pixel.y() / NarrowScene::kSide - 0.5) * shear;
    }
    Map best = map;
    mapper.adapt_to_cameras(0, Adaption::kToTheEnd, &best);
    for (const Adaption how : {Adaption::kThinned, Adaption::kTwoSeriesThinned, Adaption::kTwoSeries}) {
      Map adapted = map;
      mapper.adapt_to_cameras(0, how, &adapted);
      EXPECT_LT(rms_error(adapted, scene.camera), 1.1 * rms_error(best, scene.camera)) << fov;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Fields, ReliefOfMapTest, testing::Values(15.0, 20.0, 33.0),
                         testing::PrintToStringParamName());

}  // namespace
}  // namespace raysfm
