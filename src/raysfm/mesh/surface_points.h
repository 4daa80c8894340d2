#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// One image of a camera: its pose.
struct MeshView {
  int camera = 0;  // index into MeshScene::cameras
  Rigid3 world_from_cam;
};

// That a view sees a point.
struct Sight {
  int point = 0;  // index into MeshScene::points
  int view = 0;   // index into MeshScene::views
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

// What a surface is made of.
struct MeshScene {
  std::vector<Camera> cameras;
  std::vector<double> skews;  // of each camera, as FrameLens::skew; pixels
  std::vector<MeshView> views;
  std::vector<Sight> sights;
  std::vector<MapPoint> points;
  double error_px = 1;  // root mean square of reprojection
};

// A point that is known well enough to lie on the surface.
struct SurfacePoint {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double sigma = 0;  // largest standard deviation of the position, poses held fixed
  double pixel = 0;  // length that a pixel of the nearest view covers there
  std::array<uint8_t, 3> rgb = {128, 128, 128};
  std::vector<Eigen::Vector3d> eyes;  // where the rays that see it begin
  std::vector<int> views;             // of these rays, index into MeshScene::views
};

// The points that two rays or more see, within a few pixels of where they are, of a position that is known
// within a fiftieth of their distance; surest first. Rays are those of the pixels, so that cameras whose rays
// do not meet count as what they are.
std::vector<SurfacePoint> surface_points(const MeshScene& scene);

}  // namespace raysfm
