#include "raysfm/robust/three_view_sample.h"

#include <limits>
#include <span>

#include "raysfm/geometry/triangulation.h"
#include "raysfm/solvers/five_point.h"
#include "raysfm/solvers/p3p.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

bool resect(const std::array<Vector3d, 5>& bearings, const std::array<Vector3d, 5>& points,
            Rigid3* cam_from_world) {
  std::array<Rigid3, 4> poses;
  const int count = p3p(std::span(bearings).first<3>(), std::span(points).first<3>(), &poses);
  double best = std::numeric_limits<double>::infinity();
  for (int k = 0; k < count; ++k) {
    double error = 0;
    for (int i = 3; i < 5; ++i) error += ((poses[k] * points[i]).normalized() - bearings[i]).squaredNorm();
    if (error < best) best = error, *cam_from_world = poses[k];
  }
  return count > 0;
}

int five_point_motions(const FiveBearings& b, std::array<ThreeViewMotion, 10>* motions) {
  std::array<Matrix3d, 10> essentials;
  const int count = five_point(b[0], b[2], &essentials);
  int found = 0;
  for (int k = 0; k < count; ++k) {
    ThreeViewMotion& motion = (*motions)[found];
    if (choose_pose(essentials[k], b[0], b[2], &motion.cam2_from_cam0) < 5) continue;
    const Rigid3 cam0_from_cam2 = motion.cam2_from_cam0.inverse();
    std::array<Vector3d, 5> points;
    bool triangulated = true;
    for (int i = 0; i < 5; ++i) {
      triangulated =
          triangulated &&
          triangulate_midpoint({Vector3d::Zero(), b[0][i]},
                               {cam0_from_cam2.translation, cam0_from_cam2.rotation * b[2][i]}, &points[i]);
    }
    if (triangulated && resect(b[1], points, &motion.cam1_from_cam0)) ++found;
  }
  return found;
}

}  // namespace raysfm
