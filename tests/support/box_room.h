#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "raysfm/camera/pixel_finder.h"
#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/image/image.h"
#include "raysfm/mesh/surface_points.h"

namespace raysfm::testing_support {

// Half the sides of a room about the origin, metres.
inline const Eigen::Vector3d kRoomHalf(2, 1.25, 3);

// Colour of a point of the walls: red, green, blue; smooth.
inline std::array<double, 3> wall_color(const Eigen::Vector3d& x) {
  return {128 + 100 * std::sin(2 * x.x() + x.y()), 128 + 100 * std::sin(1.5 * x.z() - x.y()),
          128 + 100 * std::cos(1.8 * x.y() + x.x() - x.z())};
}

// Where a ray that begins in the room meets a wall.
inline Eigen::Vector3d on_wall(const Ray& ray) {
  double nearest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k) {
    const double along = (std::copysign(kRoomHalf[k], ray.direction[k]) - ray.origin[k]) / ray.direction[k];
    if (along > 0) nearest = std::min(nearest, along);
  }
  return ray.origin + nearest * ray.direction;
}

// The walls seen by `views` views of a camera from places and sides that differ: exact points, spread evenly,
// pixels with noise.
inline MeshScene box_room(const Camera& camera, int views, int points, double noise_px) {
  Rng rng(5);
  MeshScene scene;
  scene.cameras = {camera};
  scene.skews = {0};
  scene.error_px = std::max(0.1, noise_px);
  for (int i = 0; i < points; ++i) {
    Eigen::Vector3d x;
    for (int k = 0; k < 3; ++k) x[k] = rng.uniform(-1, 1) * kRoomHalf[k];
    x[i % 3] = std::copysign(kRoomHalf[i % 3], i % 6 < 3 ? -1 : 1);
    scene.points.push_back({x, {200, 100, 50}, 0});
  }
  const PixelFinder finder(camera);
  for (int v = 0; v < views; ++v) {
    const double turn = 2.4 * v;
    const Rigid3 world_from_cam{
        exp_so3({0, turn, 0}) * exp_so3({0.9 * std::sin(1.3 * v), 0, 0}),
        Eigen::Vector3d(1.1 * std::cos(1.7 * v), 0.5 * std::sin(2.3 * v), 1.9 * std::sin(1.1 * v))};
    scene.views.push_back({0, world_from_cam});
    for (int p = 0; p < points; ++p) {
      Eigen::Vector2d pixel;
      if (!finder.find(world_from_cam.inverse() * scene.points[p].position, &pixel)) continue;
      pixel += noise_px * Eigen::Vector2d(rng.normal(), rng.normal());
      if (camera.contains(pixel)) scene.sights.push_back({p, v, pixel});
    }
  }
  return scene;
}

// What a view sees: blue, green, red; black where the camera is blind.
inline Image<uint8_t> picture_of_room(const MeshScene& scene, int view) {
  const Camera& camera = scene.cameras[scene.views[view].camera];
  const Rigid3& world_from_cam = scene.views[view].world_from_cam;
  Image<uint8_t> bgr(3 * camera.width, camera.height);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      Ray ray;
      std::array<double, 3> rgb = {0, 0, 0};
      if (camera.ray({static_cast<double>(x), static_cast<double>(y)}, &ray)) {
        rgb = wall_color(on_wall({world_from_cam * ray.origin, world_from_cam.rotation * ray.direction}));
      }
      for (int c = 0; c < 3; ++c) bgr.row(y)[3 * x + c] = static_cast<uint8_t>(std::lround(rgb[2 - c]));
    }
  }
  return bgr;
}

}  // namespace raysfm::testing_support
