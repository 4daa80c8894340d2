#pragma once

namespace raysfm {

// Observations are worked on eight at a time, lane beside lane.
inline constexpr int kBlockLanes = 8;

// What the errors fill, for eight observations of one pose. Lanes whose point has no residual get an infinite
// `squared`; their other numbers are then unspecified.
struct alignas(64) ResidualBlock {
  double x[3][kBlockLanes];         // in: the point in the rig's frame
  double residual[2][kBlockLanes];  // r
  double jacobian[6][kBlockLanes];  // A = dr/dx by rows
  double squared[kBlockLanes];      // |r|^2
};

// Eight observations of one pose. With x = R X + t the point in the rig's frame, A = dr/dx, B = dr/d(f, k1,
// k2) where the pose has a lens (N = 9), and weight w:
//   point side   Jp = A R              V = w Jp^T Jp,  gp = w Jp^T r
//   pose side    Jc = [A, -A [x]x, B]  U = w Jc^T Jc,  gc = w Jc^T r,  W = w Jc^T Jp
// (left tangent of rig_from_world, geometry/pose.h).
template <int N>
struct alignas(64) ObservationBlock : ResidualBlock {
  double lens[N == 9 ? 6 : 1][kBlockLanes];  // B by rows
  double weight[kBlockLanes];                // lanes of weight zero may hold any finite numbers
  // Out.
  double point[9][kBlockLanes];      // V: xx, xy, xz, yy, yz, zz; gp
  double cross[3 * N][kBlockLanes];  // W, Nx3 by columns
};

// A lane that has no residual but must not disturb the sums: all zero but the weight.
template <int N>
void clear_lane(ObservationBlock<N>& block, int k) {
  for (auto& row : block.x) row[k] = 0;
  for (auto& row : block.residual) row[k] = 0;
  for (auto& row : block.jacobian) row[k] = 0;
  for (auto& row : block.lens) row[k] = 0;
  block.squared[k] = 0;
}

}  // namespace raysfm
