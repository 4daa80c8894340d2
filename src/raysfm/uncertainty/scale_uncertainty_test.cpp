// What errors of a calibration do to a scale, against what they do where a map is adjusted with them.
#include "raysfm/uncertainty/scale_uncertainty.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/bundle/scale_estimate.h"
#include "raysfm/geometry/rotation.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

Rig back_to_back() {
  Rig rig{{test::pinhole_camera(), test::pinhole_camera()}};
  rig.cameras[0].rig_from_cam.translation = {0.25, 0, 0};
  rig.cameras[1].rig_from_cam = {exp_so3({0, std::numbers::pi, 0}), {-0.25, 0, 0}};
  return rig;
}

// It turns as it goes, and each of its cameras sees half of the points: what `rig` sees, exactly.
test::BundleScene scene_of(const Rig& rig) {
  Rng rng(4);
  test::BundleScene scene;
  scene.cameras = rig.cameras;
  for (int i = 0; i < 8; ++i) {
    const Rigid3 world_from_rig{exp_so3(i * Eigen::Vector3d(0.03, 0.05, -0.04)),
                                Eigen::Vector3d(0.15 * i, 0.02 * i, 0.05 * i)};
    scene.true_poses.push_back(world_from_rig.inverse());
    scene.pose_is_free.push_back(i > 0);
  }
  for (int p = 0; p < 160; ++p) {
    const Camera& camera = rig.cameras[p % 2];
    const Eigen::Vector3d in_cam(rng.uniform(-1.2, 1.2), rng.uniform(-0.9, 0.9), rng.uniform(4, 6));
    scene.true_points.push_back(camera.rig_from_cam * in_cam);
    for (int i = 0; i < 8; ++i) {
      Eigen::Vector2d pixel;
      if (camera.project(camera.rig_from_cam.inverse() * (scene.true_poses[i] * scene.true_points[p]),
                         &pixel))
        scene.observations.push_back({i, p, p % 2, pixel});
    }
  }
  scene.is_inlier.assign(scene.observations.size(), 1);
  scene.poses = scene.true_poses;
  scene.points = scene.true_points;
  return scene;
}

double extent(std::span<const Rigid3> rig_from_world) {
  Eigen::Matrix3Xd places(3, rig_from_world.size());
  for (size_t i = 0; i < rig_from_world.size(); ++i) places.col(i) = rig_from_world[i].inverse().translation;
  return (places.colwise() - places.rowwise().mean()).norm();
}

// By which the scale is wrong, as a logarithm, of what `truth` sees, adjusted with `assumed`.
double error_of_scale(const Rig& truth, const Rig& assumed) {
  test::BundleScene scene = scene_of(truth);
  scene.cameras = assumed.cameras;
  BundleProblem problem = scene.problem();
  BundleAdjuster adjuster;
  adjuster.adjust(problem, {.max_iterations = 500, .min_relative_decrease = 1e-15, .initial_damping = 1e-9});
  return std::log(extent(scene.poses) / extent(scene.true_poses));
}

double stated_error(const Rig& truth, const std::vector<Rig>& deviations) {
  test::BundleScene scene = scene_of(truth);
  std::vector<Eigen::Vector2d> by_residual;
  EXPECT_TRUE(estimate_scale(scene.problem(), {}, &by_residual));
  return scale_sigma_by_calibration(scene.problem(), by_residual, TrackingRig(truth), deviations);
}

TEST(ScaleUncertainty, IsTheErrorThatAnotherCalibrationMakes) {
  const Rig rig = back_to_back();
  Rig longer = rig, turned = rig, wider = rig;
  std::get<Pinhole>(longer.cameras[0].model).fx *= 1.0005;
  std::get<Pinhole>(longer.cameras[0].model).fy *= 1.0005;
  turned.cameras[1].rig_from_cam.rotation = turned.cameras[1].rig_from_cam.rotation * exp_so3({0, 3e-3, 0});
  for (Camera& camera : wider.cameras) camera.rig_from_cam.translation *= 1.01;
  double squares = 0;
  for (const Rig& other : {longer, turned, wider}) {
    const double error = error_of_scale(rig, other);
    EXPECT_GT(std::abs(error), 1e-3);
    EXPECT_NEAR(stated_error(rig, {other}), std::abs(error), 0.1 * std::abs(error));
    squares += error * error;
  }
  EXPECT_NEAR(stated_error(rig, {longer, turned, wider}), std::sqrt(squares), 0.1 * std::sqrt(squares));
  EXPECT_NEAR(stated_error(rig, {wider}), std::log(1.01), 1e-4);  // the world is as much wider
}

}  // namespace
}  // namespace raysfm
