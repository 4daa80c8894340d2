#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "raysfm/geometry/pose.h"
#include "raysfm/robust/three_view_kernel.h"

namespace raysfm {

// Poses of views 1 and 2 of a central camera in the frame of view 0; |cam2_from_cam0.translation| = 1.
struct ThreeViewMotion {
  Rigid3 cam1_from_cam0, cam2_from_cam0;
};

// Unit bearings of the same points in three views, spans of one length.
struct ThreeViewBearings {
  std::array<std::span<const Eigen::Vector3d>, 3> views;
  int size() const { return static_cast<int>(views[0].size()); }
};

// Inverse distance rho >= 0 from view 0 of a point on the ray b0 that fits b2 best: the point is seen by view
// 2 along R b0 + rho t. Zero for a point at infinity, so that no parallax is needed.
double inverse_distance(const Eigen::Matrix3d& cam2_from_cam0_rotation, const Eigen::Vector3d& translation,
                        const Eigen::Vector3d& b0, const Eigen::Vector3d& b2);

// Least sum of squared tangents of the angles in the three views, over both poses (11 parameters, the scale
// held by |t2| = 1) and the points, which are eliminated. Keeps its buffers from call to call.
class ThreeViewRefiner {
 public:
  // Levenberg-Marquardt on the matches `active` from *motion. Returns the sum of squares, which never rises;
  // infinite when a point lies behind a view at the start or there are fewer than five.
  double refine(const ThreeViewBearings& bearings, std::span<const int> active, int max_iterations,
                ThreeViewMotion* motion);

 private:
  void start(const ThreeViewBearings& bearings, std::span<const int> active, const ThreeViewMotion& motion);

  std::vector<ThreeViewPoints> points_;
};

}  // namespace raysfm
