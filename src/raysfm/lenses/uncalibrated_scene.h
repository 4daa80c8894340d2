#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <limits>
#include <vector>

#include "raysfm/geometry/pose.h"
#include "raysfm/lenses/lens.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/lenses/radial_distortion.h"

namespace raysfm {

// Poses, lenses and points of the images and points of PointTracks; scale and world frame are free.
struct UncalibratedScene {
  std::vector<Rigid3> cam_from_world;   // one per image
  std::vector<Lens> lenses;             // one per image
  std::vector<Eigen::Vector3d> points;  // world frame
};

// Where a point is seen less where it was observed, pixels; infinite where it is not in front of the camera.
inline Eigen::Vector2d pixel_residual(const Rigid3& cam_from_world, const Lens& lens,
                                      const RadialDistortion& radial, const Eigen::Vector3d& point,
                                      const Eigen::Vector2d& observed) {
  const Eigen::Vector3d x = cam_from_world * point;
  if (!(x.z() > 0)) return Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  const Eigen::Vector2d m = x.hnormalized();
  return lens.pixel(radial.none() ? m : radial(m)) - observed;
}

// The same of an observation of the tracks whose images and points the scene has.
inline Eigen::Vector2d pixel_residual(const PointTracks& tracks, const UncalibratedScene& scene,
                                      const RadialDistortion& radial, int observation) {
  const int image = tracks.image[observation];
  return pixel_residual(scene.cam_from_world[image], scene.lenses[image], radial,
                        scene.points[tracks.point[observation]], tracks.pixel[observation]);
}

}  // namespace raysfm
