#pragma once

#include <cmath>
#include <numbers>

#include "raysfm/core/random.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/lenses/uncalibrated_scene.h"

namespace raysfm::test_scenes {

// Points in a cube of side 1 about the origin, cameras 5 to 9 away that look at it, rolled (IFBA01 5.1).
struct CubeOptions {
  int images = 6;
  int points = 25;
  bool zooming =
      false;  // focal length 800 to 1300 and each its own principal point; else 1000 and the centre
  double principal_point_spread = 0;  // pixels, about the centre, where zooming
  double arc = 2.4;                   // radians either side within which the cameras stand
};

inline constexpr double kSide = 500;  // of the image, pixels; points may lie outside

struct Cube {
  UncalibratedScene truth;
  PointTracks tracks;  // every point in every image, without noise
};

inline Rigid3 looking_at_origin(const Eigen::Vector3d& position, double roll) {
  const Eigen::Vector3d z = -position.normalized();
  const Eigen::Vector3d x = Eigen::Vector3d::UnitY().cross(z).normalized();
  Eigen::Matrix3d world_from_cam;
  world_from_cam << x, z.cross(x), z;
  const Eigen::Quaterniond q =
      exp_so3({0, 0, roll}) * Eigen::Quaterniond(world_from_cam.transpose().eval()).normalized();
  return {q, -(q * position)};
}

inline void project_all(const UncalibratedScene& scene, PointTracks* tracks) {
  *tracks = {.image_count = static_cast<int>(scene.cam_from_world.size()),
             .point_count = static_cast<int>(scene.points.size()),
             .image_size = {kSide + 1, kSide + 1},
             .image = {},
             .point = {},
             .pixel = {}};
  for (int j = 0; j < tracks->image_count; ++j) {
    for (int i = 0; i < tracks->point_count; ++i) {
      const Eigen::Vector3d x = scene.cam_from_world[j] * scene.points[i];
      tracks->add(j, i, scene.lenses[j].pixel(x.head<2>() / x.z()));
    }
  }
}

inline Cube make_cube(const CubeOptions& options, Rng* rng) {
  Cube cube;
  for (int i = 0; i < options.points; ++i) {
    cube.truth.points.emplace_back(rng->uniform(-0.5, 0.5), rng->uniform(-0.5, 0.5), rng->uniform(-0.5, 0.5));
  }
  for (int j = 0; j < options.images; ++j) {
    const double share = options.images > 1 ? double(j) / (options.images - 1) - 0.5 : 0;
    const double azimuth = 2 * options.arc * share + rng->uniform(-0.1, 0.1);
    const double elevation = rng->uniform(-1.0, 1.0), distance = rng->uniform(5, 9);
    const Eigen::Vector3d position =
        distance * Eigen::Vector3d(std::cos(elevation) * std::sin(azimuth), std::sin(elevation),
                                   std::cos(elevation) * std::cos(azimuth));
    Rigid3 pose = looking_at_origin(position, rng->uniform(-0.5, 0.5));
    // Not exactly at the middle: axes through one point are a degenerate motion.
    pose.translation += Eigen::Vector3d(rng->uniform(-0.3, 0.3), rng->uniform(-0.3, 0.3), 0);
    cube.truth.cam_from_world.push_back(pose);
    Lens lens{1000, 1000, kSide / 2, kSide / 2, 0};
    if (options.zooming) {
      lens.fx = lens.fy = rng->uniform(800, 1300);
      lens.cx += options.principal_point_spread * rng->normal();
      lens.cy += options.principal_point_spread * rng->normal();
    }
    cube.truth.lenses.push_back(lens);
  }
  project_all(cube.truth, &cube.tracks);
  return cube;
}

inline void add_noise(double sigma, Rng* rng, PointTracks* tracks) {
  for (Eigen::Vector2d& p : tracks->pixel) p += sigma * Eigen::Vector2d(rng->normal(), rng->normal());
}

// Poses, points and lenses moved: `amount` radians, shares of the distance, of the cube, of the focal length.
inline UncalibratedScene perturbed(const UncalibratedScene& truth, double amount, Rng* rng) {
  UncalibratedScene scene = truth;
  const auto vector = [rng] { return Eigen::Vector3d(rng->normal(), rng->normal(), rng->normal()); };
  for (Rigid3& pose : scene.cam_from_world) {
    const double distance = pose.translation.norm();
    Eigen::Matrix<double, 6, 1> delta;
    delta << 0.3 * amount * distance * vector(), amount * vector();
    pose = retract(pose, delta);
  }
  for (Eigen::Vector3d& point : scene.points) point += amount * vector();
  for (Lens& lens : scene.lenses) lens.fx = lens.fy = lens.fx * (1 + amount * rng->normal());
  return scene;
}

// Root mean square difference between the distances of the points and their true distances, after the best
// scale: the structure error of IFBA01 5.1 without its count of pairs.
inline double structure_error(const std::vector<Eigen::Vector3d>& points,
                              const std::vector<Eigen::Vector3d>& truth) {
  double dot = 0, square = 0, sum = 0;
  size_t pairs = 0;
  const auto each = [&](auto&& body) {
    for (size_t i = 0; i < points.size(); ++i) {
      for (size_t k = 0; k < i; ++k) body((points[i] - points[k]).norm(), (truth[i] - truth[k]).norm());
    }
  };
  each([&](double a, double b) { dot += a * b, square += a * a, ++pairs; });
  const double scale = dot / square;
  each([&](double a, double b) { sum += (scale * a - b) * (scale * a - b); });
  return std::sqrt(sum / double(pairs));
}

}  // namespace raysfm::test_scenes
