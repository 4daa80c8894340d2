#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/mapping/mapper.h"

namespace raysfm::testing_support {

// A cloud as deep as it is wide, in the middle of what a camera sees that goes round it by degrees and turns
// away a little: so many pixels wide, whatever the field of view.
struct NarrowScene {
  static constexpr double kSide = 640;  // pixels
  Camera camera;
  std::vector<Rigid3> cam_from_world;
  std::vector<Eigen::Vector3d> points;

  explicit NarrowScene(double fov_deg, int views = 6) {
    const double focal = 0.5 * kSide / std::tan(0.5 * fov_deg * std::numbers::pi / 180);
    camera.width = camera.height = static_cast<int>(kSide);
    camera.model = Pinhole{focal, focal, 0.5 * kSide, 0.5 * kSide};
    const double distance = focal / kSide;  // the cloud is as wide as 0.6 of the image
    Rng rng(3);
    const auto uniform = [&] { return 2 * rng.uniform() - 1; };
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d offset(uniform(), uniform(), uniform());
      points.push_back(Eigen::Vector3d(0, 0, distance) + 0.25 * offset);
    }
    for (int k = 0; k < views; ++k) {
      const Eigen::Quaterniond round(Eigen::AngleAxisd(0.03 * k, Eigen::Vector3d(0.3, 1, 0.1).normalized()));
      const Eigen::Quaterniond away(
          Eigen::AngleAxisd(0.02 * k / distance, Eigen::Vector3d(1, 0.2 * k, 0).normalized()));
      const Eigen::Vector3d middle(0, 0, distance);
      cam_from_world.push_back({away * round, away * (middle - round * middle)});
    }
  }

  Eigen::Vector2d pixel(const Rigid3& pose, const Eigen::Vector3d& point) const {
    Eigen::Vector2d pixel;
    EXPECT_TRUE(camera.project(pose * point, &pixel));
    return pixel;
  }

  // Root mean square of the distances in the image to what another scene shows.
  double apart(const NarrowScene& other) const {
    double sum = 0;
    for (size_t k = 0; k < cam_from_world.size(); ++k) {
      for (size_t i = 0; i < points.size(); ++i) {
        sum += (pixel(cam_from_world[k], points[i]) - pixel(other.cam_from_world[k], other.points[i]))
                   .squaredNorm();
      }
    }
    return std::sqrt(sum / static_cast<double>(cam_from_world.size() * points.size()));
  }

  void reverse() { reverse_relief(cam_from_world, points); }
};

// The map of what a scene shows, with the poses and points of another.
inline Map map_of(const TrackingRig& rig, const NarrowScene& shown, const NarrowScene& believed) {
  Map map;
  Rng rng(5);
  for (const Eigen::Vector3d& point : believed.points) {
    Track& track = map.tracks.emplace_back();
    track.position = point;
    track.triangulated = track.had_position = true;
  }
  for (size_t k = 0; k < shown.cam_from_world.size(); ++k) {
    map.keyframes.emplace_back();
    map.keyframes.back().frame = static_cast<int>(k);
    map.keyframes.back().rig_from_world = believed.cam_from_world[k];
    for (size_t i = 0; i < shown.points.size(); ++i) {
      TrackPixel seen{.track = static_cast<int>(i)};
      const Eigen::Vector2d noise = 0.3 * Eigen::Vector2d(rng.normal(), rng.normal());
      seen.pixel = (shown.pixel(shown.cam_from_world[k], shown.points[i]) + noise).cast<float>();
      EXPECT_TRUE(observe(rig, seen, static_cast<int>(k), &map));
    }
  }
  return map;
}

}  // namespace raysfm::testing_support
