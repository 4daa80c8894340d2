#pragma once

namespace raysfm {

// Observations are worked on eight at a time, lane beside lane.
inline constexpr int kBundleLanes = 8;

// Eight observations of one pose by one camera. With x = R X + t the point in the rig's frame, A = dr/dx and
// weight w:
//   point side   Jp = A R          V = w Jp^T Jp,  gp = w Jp^T r
//   pose side    Jc = A [I -[x]x]  U = w Jc^T Jc,  gc = w Jc^T r,  W = w Jc^T Jp
// (left tangent of rig_from_world, geometry/pose.h).
struct alignas(64) ObservationBlock {
  // In. x is the point in the world until transform_points(). Lanes of weight zero may hold any finite
  // numbers.
  double x[3][kBundleLanes];
  double residual[2][kBundleLanes];
  double jacobian[6][kBundleLanes];  // A by rows
  double weight[kBundleLanes];
  // Out.
  double point[9][kBundleLanes];   // V: xx, xy, xz, yy, yz, zz; gp
  double cross[18][kBundleLanes];  // W, 6x3 by columns
};

// Sums over the blocks of one pose, lane by lane, so that they do not depend on the width of the vectors.
// The order of the 27 numbers is that of add_pose_sums().
struct alignas(64) PoseSums {
  double sum[27][kBundleLanes];
};

// All for `count` blocks; R by rows.

// x becomes R x + t.
void transform_points(const double* rotation, const double* translation, ObservationBlock* blocks, int count);

// Fills `point`.
void point_terms(const double* rotation, ObservationBlock* blocks, int count);

// Fills `point` and `cross` and adds the pose side to `sums`.
void point_and_pose_terms(const double* rotation, ObservationBlock* blocks, int count, PoseSums* sums);

// Adds the sums over all lanes to U (6x6 by columns, lower triangle) and gc.
void add_pose_sums(const PoseSums& sums, double* u, double* gradient);

}  // namespace raysfm
