#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "raysfm/robust/generic_start.h"

namespace raysfm {

// The matches of a start, checked and sorted by point: rays [begin, end) are those of a point, one origin for
// all moved to where most of them meet.
struct RigTable {
  struct Point {
    int index = 0;                    // in RigMatches
    int begin = 0, end = 0;           // its rays
    std::array<int, 3> primary;       // the ray of each view that the search looks at
    int camera = -1;                  // of all three primary rays; -1: they differ
    double weight1 = 0, weight2 = 0;  // (unit of the residuals per radian)^2 of primary rays 1 and 2
  };
  std::vector<Point> points;
  std::vector<ObservedRay> rays;                     // in the rig's frame, less `centre`
  std::vector<int> views;                            // of each ray
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // mean origin of the camera with most points
  int main_camera = -1;                              // that camera

  int size() const { return static_cast<int>(points.size()); }
  Ray ray(int i) const { return {rays[i].origin, rays[i].direction}; }
  Ray primary(const Point& point, int view) const { return ray(point.primary[view]); }
};

// Leaves out rays that are not finite or whose point or view is out of range, and points without a ray in
// each view. The primary rays of a point are of one camera where one sees it in all three views.
RigTable make_rig_table(const RigMatches& matches);

// Poses of views 1 and 2 of a rig in the frame of view 0.
struct RigMotion {
  Rigid3 rig1_from_rig0, rig2_from_rig0;
};

}  // namespace raysfm
