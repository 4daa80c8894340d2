#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/robust/rig_table.h"

namespace raysfm {

// Least sum of squared residuals of rays in three views over both poses and the points. A point is a
// direction and an inverse distance along its primary ray of view 0, so that points at infinity do not hurt;
// the points are eliminated. Keeps its buffers from call to call.
class RigRefiner {
 public:
  struct Options {
    int max_iterations = 15;
    double min_decrease = 1e-5;  // of the cost, relative: an iteration that wins less is the last
    bool hold_scale = false;     // the length of rig2_from_rig0's translation (in the table's frame) stays
  };
  // Levenberg-Marquardt on the points `active` of the table from *motion. Returns the sum of squares, which
  // never rises; infinite when a point lies behind a ray at the start or there are fewer than six.
  double refine(const RigTable& table, std::span<const int> active, const Options& options,
                RigMotion* motion);

 private:
  struct Point {
    int begin, end;  // rays
    Eigen::Vector3d origin, direction;
    double inverse_distance;
    // Of the last linearisation, to follow a step of the poses.
    Eigen::Matrix<double, 3, 12> by_poses;
    Eigen::Matrix3d inverse_hessian;
    Eigen::Vector3d gradient;
  };
  void start(const RigTable& table, std::span<const int> active, const RigMotion& motion);
  void linearise(const RigTable& table, const RigMotion& motion, double damping,
                 Eigen::Matrix<double, 12, 12>* hessian, Eigen::Matrix<double, 12, 1>* gradient);
  double cost(const RigTable& table, const RigMotion& motion, const std::vector<Point>& points) const;

  std::vector<Point> points_, moved_;
};

}  // namespace raysfm
