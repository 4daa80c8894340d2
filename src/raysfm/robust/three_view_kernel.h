#pragma once

#include <array>

namespace raysfm {

// Points side by side; numbers of a step of the poses, and of the upper triangle of their equations.
inline constexpr int kPointLanes = 8;
inline constexpr int kPoseNumbers = 11;
inline constexpr int kHessianNumbers = kPoseNumbers * (kPoseNumbers + 1) / 2;

// Points of three views, eight side by side, for ThreeViewRefiner. A point is where its bearing in view 0 was
// moved in its tangent plane, over an inverse distance, so that points at infinity do not hurt.
struct ThreeViewPoints {
  using Lane = double[kPointLanes];

  alignas(64) Lane bearings[3][3];     // of each view
  alignas(64) Lane tangents[3][2][3];  // rows orthogonal to the bearing; of points that do not count zero
  alignas(64) Lane place[3];           // two along the tangents of view 0, inverse distance
  alignas(64) Lane moved[3];           // the same after a step
  // Of the last linearisation, to follow a step of the poses: point by pose, inverse of the point's own part
  // of the equations (upper triangle by rows), right side.
  alignas(64) Lane by_poses[3][kPoseNumbers];
  alignas(64) Lane inverse[6];
  alignas(64) Lane gradient[3];
};

// Poses of views 1 and 2 in the frame of view 0 (rotations by rows), and the two directions in which the
// translation of view 2 may move.
struct ThreeViewPoses {
  std::array<double, 9> rotations[2];
  std::array<double, 3> translations[2];
  std::array<std::array<double, 3>, 2> baseline_tangents;
};

// What points say of the poses, themselves eliminated, as sums: 11 numbers of the step, 6 for view 1
// (translation, rotation) and 5 for view 2 (along the baseline's tangents, rotation). Upper triangle by rows.
struct ThreeViewSums {
  std::array<double, kHessianNumbers> hessian;
  std::array<double, kPoseNumbers> gradient;
};

// Levenberg-Marquardt's equations: diagonals are multiplied by 1 + damping.
void linearise_three_views(const ThreeViewPoses& poses, double damping, ThreeViewPoints* points, int groups,
                           ThreeViewSums* sums);

// The points' part of a step of the poses: sets `moved`.
void move_three_view_points(const std::array<double, kPoseNumbers>& step, ThreeViewPoints* points,
                            int groups);

// Sum of squared tangents of the angles between bearings and where points are seen, from `moved` or from
// `place`; infinite where one lies behind a view.
double three_view_cost(const ThreeViewPoses& poses, const ThreeViewPoints* points, int groups, bool moved);

}  // namespace raysfm
