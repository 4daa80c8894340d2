#include "raysfm/uncalibrated/pose_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/uncalibrated/video_resection.h"

namespace raysfm {
namespace {

// Points about a camera at the origin of the world, turned a little.
struct Scene {
  UncalibratedReconstruction found;
  PointTracks tracks;
};

Scene make_scene(bool zooming) {
  Rng rng(11);
  Scene scene;
  scene.tracks.image_count = 1;
  scene.tracks.point_count = 80;
  scene.tracks.image_size = {640, 480};
  UncalibratedReconstruction& r = scene.found;
  r.zooming = zooming;
  r.scene.cam_from_world = {{exp_so3(Eigen::Vector3d(0.1, -0.2, 0.3)), {0.2, 0.1, 0.5}}};
  r.scene.lenses = {{500, 500, 319.5, 239.5, 0}};
  r.image_posed = {1};
  for (int i = 0; i < 80; ++i) {
    const double z = rng.uniform(3, 9);
    const Eigen::Vector3d x(z * rng.uniform(-0.6, 0.6), z * rng.uniform(-0.45, 0.45), z);
    r.scene.points.push_back(r.scene.cam_from_world[0].inverse() * x);
    scene.tracks.add(0, i, r.scene.lenses[0].pixel(x.hnormalized()));
  }
  r.point_placed.assign(80, 1);
  r.inlier.assign(80, 1);
  return scene;
}

// The tangent that leads from a to b.
Vector6d difference(const Rigid3& b, const Rigid3& a) {
  const Rigid3 step = b * a.inverse();
  Vector6d d;
  d << step.translation, log_so3(step.rotation);
  return d;
}

// The mean of d^T C^-1 d over noisy trials is the number of dimensions.
double mean_mahalanobis(bool zooming) {
  constexpr int kTrials = 300;
  const Scene truth = make_scene(zooming);
  const Eigen::Matrix<double, 6, 6> unit = [&] {
    // Of one pixel of noise: half of the sum of squares is what 2 n - unknowns degrees of freedom leave.
    Scene noisy = truth;
    const double freedom = 2 * 80 - (zooming ? 9 : 6);
    const double offset = std::sqrt(freedom / 80);
    for (size_t i = 0; i < noisy.tracks.pixel.size(); ++i)
      noisy.tracks.pixel[i].x() += i % 2 ? offset : -offset;
    return pose_covariances(noisy.tracks, noisy.found)[0];
  }();
  Rng rng(5);
  double sum = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    constexpr double kNoise = 0.5;
    std::vector<Eigen::Vector2d> pixels = truth.tracks.pixel;
    for (Eigen::Vector2d& p : pixels) p += kNoise * Eigen::Vector2d(rng.normal(), rng.normal());
    LensResection view;
    EXPECT_TRUE(resect_with_lens(
        truth.found.scene.points, pixels, truth.found.scene.cam_from_world[0], truth.found.scene.lenses[0],
        {.max_error_px = 30, .zooming = zooming, .principal_point_sigma_px = 19.2}, &view));
    const Vector6d d = difference(view.cam_from_world, truth.found.scene.cam_from_world[0]);
    sum += d.dot(unit.inverse() * d) / (kNoise * kNoise) / kTrials;
  }
  return sum;
}

// The standard deviation of the mean is sqrt(12 / 300) = 0.2.
TEST(PoseCovariance, SpreadOfNoisyPosesFixedLens) {
  EXPECT_NEAR(mean_mahalanobis(false), 6, 0.8);
}
TEST(PoseCovariance, SpreadOfNoisyPosesZoomingLens) {
  EXPECT_NEAR(mean_mahalanobis(true), 6, 0.8);
}

TEST(PoseCovariance, NoPoseAndTooFewInliers) {
  Scene scene = make_scene(false);
  scene.found.inlier.assign(80, 0);
  EXPECT_TRUE(std::isinf(pose_covariances(scene.tracks, scene.found)[0](0, 0)));
  scene.found.image_posed = {0};
  EXPECT_EQ(pose_covariances(scene.tracks, scene.found)[0].norm(), 0);
}

}  // namespace
}  // namespace raysfm
