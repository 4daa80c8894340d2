// Key frames adjusted to noisy pixels of a known scene: their errors against what the covariances say.
#include "raysfm/uncertainty/window_covariance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/eval/consistency.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

using test::BundleScene;
using test::make_bundle_scene;

constexpr int kKeyFrames = 10, kEveryPoint = 100000;
constexpr double kNoise = 0.4;  // pixels
constexpr RobustLoss kNoLoss{};

BundleScene exact_scene(std::vector<Camera> cameras = {}) {
  return make_bundle_scene({.poses = kKeyFrames,
                            .free_poses = kKeyFrames,
                            .points = 400,
                            .track = 5,
                            .noise_px = 0,
                            .pose_error = 0,
                            .point_error = 0,
                            .cameras = std::move(cameras)});
}

BundleScene noisy_scene(uint64_t seed) {
  BundleScene scene = exact_scene();
  Rng rng(seed);
  for (BundleObservation& o : scene.observations)
    o.pixel += 0.3 * Eigen::Vector2d(rng.normal(), rng.normal());
  return scene;
}

// What a map holds of a scene.
Map map_of(const BundleScene& scene, double unit = 1) {
  Map map;
  map.keyframes.resize(scene.poses.size());
  for (size_t i = 0; i < scene.poses.size(); ++i) {
    map.keyframes[i].frame = static_cast<int>(i);
    map.keyframes[i].rig_from_world = {scene.poses[i].rotation, unit * scene.poses[i].translation};
  }
  for (const Eigen::Vector3d& x : scene.points) {
    Track& track = map.tracks[map.new_track()];
    track.position = unit * x;
    track.triangulated = true;
  }
  for (const BundleObservation& o : scene.observations) {
    map.observe(o.point, o.pose, map.keyframes[o.pose].add(o.camera, o.pixel.cast<float>(), 0, o.point));
  }
  return map;
}

struct Trials {
  double held = 0, held_orientations = 0, factor = 0;
};

// Cameras whose focal length is longer by a part of itself and whose principal point is another.
std::vector<Camera> changed(std::vector<Camera> cameras, double focal, double centre) {
  for (Camera& camera : cameras) {
    auto& lens = std::get<Pinhole>(camera.model);
    lens.fx *= 1 + focal, lens.fy *= 1 + focal;
    lens.cx += centre;
  }
  return cameras;
}

// Standard deviations of both, and whether the covariance is told.
struct WrongLens {
  double focal = 0, centre = 0;  // part; pixels
  bool is_told = true;
};

// `shared`: part of the variance of a pixel's error that all points of a neighbourhood have in common.
Trials draw(const BundleScene& scene, double shared, int trials, Alignment alignment = Alignment::kSim3,
            const WrongLens& wrong = {}) {
  const std::array lengths = {kKeyFrames};
  Rng rng(5);
  Trials sums;
  BundleAdjuster adjuster;
  for (int trial = 0; trial < trials; ++trial) {
    BundleScene noisy = scene;
    std::map<std::array<int, 4>, Eigen::Vector2d> of_neighbourhood;
    for (BundleObservation& o : noisy.observations) {
      const std::array cell = {o.pose, o.camera, static_cast<int>(o.pixel.x() / 107),
                               static_cast<int>(o.pixel.y() / 120)};
      auto [it, is_new] = of_neighbourhood.try_emplace(cell);
      if (is_new) it->second = kNoise * Eigen::Vector2d(rng.normal(), rng.normal());
      o.pixel += std::sqrt(shared) * it->second +
                 std::sqrt(1 - shared) * kNoise * Eigen::Vector2d(rng.normal(), rng.normal());
    }
    noisy.cameras = changed(scene.cameras, wrong.focal * rng.normal(), wrong.centre * rng.normal());
    const TrackingRig rig(Rig{noisy.cameras});
    std::vector<Rig> deviations;
    if (wrong.is_told && wrong.focal > 0)
      deviations = {{changed(noisy.cameras, wrong.focal, 0)}, {changed(noisy.cameras, 0, wrong.centre)}};
    adjuster.adjust(noisy.problem(), {.max_iterations = 20, .min_relative_decrease = 1e-9});
    Map map = map_of(noisy);
    map.scale_sigma = alignment == Alignment::kSe3 ? 0.01 : INFINITY;
    const auto window = window_covariance(rig, map, 0, kKeyFrames, kNoLoss, kEveryPoint, deviations);
    if (!window) {
      ADD_FAILURE() << "no covariance";
      return sums;
    }
    Trajectory estimate, truth;
    std::vector<Matrix6d> covariances;
    for (int i = 0; i < kKeyFrames; ++i) {
      const Eigen::Matrix3d back = noisy.poses[i].rotation.conjugate().toRotationMatrix();
      Matrix6d turn = Matrix6d::Zero();
      turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = back;
      covariances.push_back(turn * (window->poses[i] + window->by_calibration[i]) * turn.transpose());
      for (Trajectory* t : {&estimate, &truth}) t->timestamps.push_back(i);
      estimate.world_from_cam.push_back(noisy.poses[i].inverse());
      truth.world_from_cam.push_back(scene.true_poses[i].inverse());
    }
    const auto judged = window_consistency(estimate, covariances, truth, {alignment, 0.01}, lengths);
    sums.held += judged->front().position.held / trials;
    sums.held_orientations += judged->front().orientation.held / trials;
    sums.factor += window->variance / window->independent_variance / trials;
  }
  return sums;
}

TEST(WindowCovariance, HoldsNineInTenOfIndependentErrors) {
  const Trials t = draw(exact_scene(), 0, 150);
  EXPECT_NEAR(t.held, 0.9, 0.03);
  EXPECT_NEAR(t.held_orientations, 0.9, 0.03);
  EXPECT_NEAR(t.factor, 1, 0.1);
}

// Half of the variance in common to the points of a neighbourhood: fewer than half of the observations count.
TEST(WindowCovariance, HoldsErrorsThatNeighboursShare) {
  const Trials t = draw(exact_scene(), 0.5, 150);
  // One number stands for what they share in all directions, which is more than positions feel.
  EXPECT_GT(t.held, 0.85);
  EXPECT_LT(t.held, 0.99);
  EXPECT_NEAR(t.held_orientations, 0.9, 0.06);
  EXPECT_GT(t.factor, 1.5);
  EXPECT_LT(t.factor, 5);
}

// A lens that is off by three hundredths moves positions and orientations farther than noise does.
TEST(WindowCovariance, HoldsWhatAWrongCalibrationDoes) {
  const WrongLens told{.focal = 0.03, .centre = 9}, untold{.focal = 0.03, .centre = 9, .is_told = false};
  const Trials t = draw(exact_scene(), 0, 150, Alignment::kSim3, told);
  EXPECT_NEAR(t.held, 0.9, 0.04);
  EXPECT_NEAR(t.held_orientations, 0.9, 0.04);
  const Trials u = draw(exact_scene(), 0, 50, Alignment::kSim3, untold);
  EXPECT_LT(u.held, 0.6);
  EXPECT_LT(u.held_orientations, 0.6);
}

TEST(WindowCovariance, OfAStereoRigIsMetric) {
  Camera left = test::pinhole_camera(), right = left;
  right.rig_from_cam.translation = {0.5, 0, 0};
  const Trials t = draw(exact_scene({left, right}), 0, 100, Alignment::kSe3);
  EXPECT_NEAR(t.held, 0.9, 0.03);
  EXPECT_NEAR(t.held_orientations, 0.9, 0.03);
}

TEST(WindowCovariance, IsInTheUnitOfTheMap) {
  const BundleScene scene = noisy_scene(2);
  const TrackingRig rig(Rig{scene.cameras});
  const auto one = window_covariance(rig, map_of(scene), 0, kKeyFrames, kNoLoss, kEveryPoint);
  const auto ten = window_covariance(rig, map_of(scene, 10), 0, kKeyFrames, kNoLoss, kEveryPoint);
  ASSERT_TRUE(one && ten);
  for (int i = 0; i < kKeyFrames; ++i) {
    const double v = one->poses[i](0, 0), w = one->poses[i](4, 4);
    EXPECT_NEAR(ten->poses[i](0, 0), 100 * v, v);
    EXPECT_NEAR(ten->poses[i](4, 4), w, 0.01 * w);
  }
}

// A share of the points stands for all of them.
TEST(WindowCovariance, IsAboutTheSameFromAShareOfThePoints) {
  const BundleScene scene = noisy_scene(3);
  const TrackingRig rig(Rig{scene.cameras});
  const Map map = map_of(scene);
  const auto all = window_covariance(rig, map, 0, kKeyFrames, kNoLoss, kEveryPoint);
  const auto some = window_covariance(rig, map, 0, kKeyFrames, kNoLoss, 200);
  ASSERT_TRUE(all && some);
  double ratio = 0;
  for (int i = 0; i < kKeyFrames; ++i) {
    ratio += std::sqrt(some->poses[i].topLeftCorner<3, 3>().trace() /
                       all->poses[i].topLeftCorner<3, 3>().trace()) /
             kKeyFrames;
  }
  EXPECT_GT(ratio, 0.7);
  EXPECT_LT(ratio, 1.5);
}

// A mark from when a point was elsewhere.
TEST(WindowCovariance, WhatDoesNotFitAnyMoreSaysNothing) {
  const BundleScene scene = noisy_scene(4);
  const TrackingRig rig(Rig{scene.cameras});
  Map unmarked = map_of(scene), marked = unmarked;
  for (int f = 0; f < 30; ++f) {
    unmarked.keyframes[4].inliers[f] = 0;
    marked.keyframes[4].pixels[f].x() += 6;
  }
  const auto without = window_covariance(rig, unmarked, 0, kKeyFrames, kNoLoss, kEveryPoint);
  const auto with = window_covariance(rig, marked, 0, kKeyFrames, kNoLoss, kEveryPoint);
  ASSERT_TRUE(without && with);
  for (int i = 0; i < kKeyFrames; ++i) EXPECT_EQ(with->poses[i], without->poses[i]);
  EXPECT_EQ(with->variance, without->variance);
}

TEST(WindowCovariance, WithoutPointsInCommonThereIsNone) {
  const BundleScene scene = exact_scene();
  Map map = map_of(scene);
  for (uint8_t& inlier : map.keyframes[4].inliers) inlier = 0;
  const TrackingRig rig(Rig{scene.cameras});
  EXPECT_FALSE(window_covariance(rig, map, 0, kKeyFrames, kNoLoss, kEveryPoint));
  EXPECT_TRUE(window_covariance(rig, map, 5, kKeyFrames, kNoLoss, kEveryPoint));
}

}  // namespace
}  // namespace raysfm
