#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <vector>

#include "raysfm/bundle/bal_problem.h"
#include "raysfm/bundle/residual.h"
#include "raysfm/core/random.h"

namespace raysfm::test {

// A rig that moves along a street and what it sees: exact truth, noisy pixels, and a start off the truth.
struct BundleScene {
  std::vector<Camera> cameras;
  std::vector<Rigid3> true_poses, poses;  // rig_from_world
  std::vector<uint8_t> pose_is_free;
  std::vector<Eigen::Vector3d> true_points, points;
  std::vector<uint8_t> point_is_fixed;
  std::vector<BundleObservation> observations;
  std::vector<uint8_t> is_inlier;
  std::vector<ObservedRay> rays;  // empty until observe_rays()
  std::vector<float> sigmas;      // empty: all 1

  BundleProblem problem() {
    return {cameras, poses, pose_is_free, points, point_is_fixed, observations, is_inlier, rays, {}, sigmas};
  }
};

// The scene under the angular error. Every pixel must see something.
inline void observe_rays(BundleScene* scene, AngularWeight weight) {
  scene->rays.resize(scene->observations.size());
  for (size_t i = 0; i < scene->observations.size(); ++i) {
    const BundleObservation& o = scene->observations[i];
    observe_ray(scene->cameras[o.camera], o.pixel, weight, &scene->rays[i]);
  }
}

struct BundleSceneOptions {
  int poses = 10;
  int free_poses = 3;  // the last ones
  int points = 500;
  int track = 5;  // consecutive poses that see a point
  double noise_px = 0.5;
  double pose_error = 0.01, point_error = 0.05;  // of the start; only of what is free
  uint64_t seed = 1;
  std::vector<Camera> cameras = {};  // empty: one pinhole camera
};

inline Camera pinhole_camera() {
  Camera camera;
  camera.model = Pinhole{500, 510, 320, 240};
  camera.width = 640, camera.height = 480;
  return camera;
}

inline Eigen::Vector3d random_vector(Rng& rng, double sigma) {
  return {sigma * rng.normal(), sigma * rng.normal(), sigma * rng.normal()};
}

inline Rigid3 disturbed(const Rigid3& pose, Rng& rng, double sigma) {
  Eigen::Matrix<double, 6, 1> delta;
  delta << random_vector(rng, sigma), random_vector(rng, 0.1 * sigma);
  return retract(pose, delta);
}

inline BundleScene make_bundle_scene(const BundleSceneOptions& options) {
  Rng rng(options.seed);
  BundleScene scene;
  scene.cameras = options.cameras.empty() ? std::vector<Camera>{pinhole_camera()} : options.cameras;
  for (int i = 0; i < options.poses; ++i) {
    const Rigid3 world_from_rig{exp_so3({0.02 * std::sin(i), 0.05 * std::sin(0.3 * i), 0.01 * i}),
                                Eigen::Vector3d(0.2 * std::sin(i), 0.1 * std::cos(i), 0.7 * i)};
    scene.true_poses.push_back(world_from_rig.inverse());
    const bool is_free = i >= options.poses - options.free_poses;
    scene.pose_is_free.push_back(is_free);
    scene.poses.push_back(is_free ? disturbed(scene.true_poses[i], rng, options.pose_error)
                                  : scene.true_poses[i]);
  }
  for (int p = 0; p < options.points; ++p) {
    const int first = static_cast<int>(rng.index(std::max(1, options.poses - options.track + 1)));
    const Rigid3 world_from_rig = scene.true_poses[first].inverse();
    // In front of the first pose that sees it, and of the last.
    const double depth = 0.7 * options.track + rng.uniform(3, 15);
    const Eigen::Vector3d x(rng.uniform(-0.4, 0.4) * depth, rng.uniform(-0.3, 0.3) * depth, depth);
    scene.true_points.push_back(world_from_rig * x);
    scene.points.push_back(scene.true_points[p] + random_vector(rng, options.point_error));
    for (int i = first; i < std::min(options.poses, first + options.track); ++i) {
      for (size_t c = 0; c < scene.cameras.size(); ++c) {
        const Camera& camera = scene.cameras[c];
        Eigen::Vector2d pixel;
        if (!camera.project(camera.rig_from_cam.inverse() * (scene.true_poses[i] * scene.true_points[p]),
                            &pixel)) {
          continue;
        }
        pixel += options.noise_px * Eigen::Vector2d(rng.normal(), rng.normal());
        scene.observations.push_back({i, p, static_cast<int>(c), pixel});
      }
    }
  }
  scene.is_inlier.assign(scene.observations.size(), 1);
  return scene;
}

// A ring road in the form of Bundle Adjustment in the Large: each point is seen by `track` successive
// cameras.
struct BalSceneOptions {
  int cameras = 50;
  int points_per_camera = 60;
  int track = 8;
  double noise_px = 0.5;
  uint64_t seed = 1;
};

inline BalProblem make_bal_scene(const BalSceneOptions& options) {
  Rng rng(options.seed);
  BalProblem problem;
  std::vector<Rigid3> cam_from_world;
  // One unit from camera to camera, looking ahead, x to the right, y up, and the camera's -z forward.
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  for (int i = 0; i < options.cameras; ++i) {
    const double heading = 0.5 * std::sin(0.05 * i);
    const Eigen::Vector3d forward(std::cos(heading), std::sin(heading), 0), up(0, 0, 1);
    Eigen::Matrix3d world_from_cam;
    world_from_cam << forward.cross(up), up, -forward;
    position += forward;
    const Rigid3 pose{Eigen::Quaterniond(world_from_cam), position};
    cam_from_world.push_back(pose.inverse());
    const Eigen::Vector3d w = log_so3(cam_from_world[i].rotation), t = cam_from_world[i].translation;
    problem.cameras.push_back({w[0], w[1], w[2], t[0], t[1], t[2], rng.uniform(480, 520),
                               rng.uniform(-0.05, 0), rng.uniform(0, 0.01)});
  }
  for (int p = 0; p < options.cameras * options.points_per_camera; ++p) {
    const int first = std::min(p / options.points_per_camera, std::max(0, options.cameras - options.track));
    const double depth = options.track + rng.uniform(2, 12);
    const Eigen::Vector3d x(rng.uniform(-0.5, 0.5) * depth, rng.uniform(-0.3, 0.3) * depth, -depth);
    problem.points.push_back(cam_from_world[first].inverse() * x);
    for (int i = first; i < std::min(options.cameras, first + options.track); ++i) {
      const std::array<double, 9>& c = problem.cameras[i];
      Eigen::Vector2d pixel;
      if (!lens_residual({c[6], c[7], c[8]}, cam_from_world[i] * problem.points[p], Eigen::Vector2d::Zero(),
                         &pixel)) {
        continue;
      }
      pixel += options.noise_px * Eigen::Vector2d(rng.normal(), rng.normal());
      problem.observations.push_back({i, p, pixel});
    }
  }
  return problem;
}

// Normal noise on rotation vectors (radians), translations and points.
inline void perturb(BalProblem* problem, double rotation, double translation, double point, uint64_t seed) {
  Rng rng(seed);
  for (std::array<double, 9>& c : problem->cameras) {
    for (int k = 0; k < 3; ++k) c[k] += rotation * rng.normal();
    for (int k = 3; k < 6; ++k) c[k] += translation * rng.normal();
  }
  for (Eigen::Vector3d& x : problem->points) x += random_vector(rng, point);
}

}  // namespace raysfm::test
