#pragma once

#include <span>
#include <vector>

#include "raysfm/optim/aligned_vector.h"
#include "raysfm/optim/block_cholesky.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/optim/schur_kernels.h"

namespace raysfm {

// The normal equations of a bundle adjustment and their damped solution (LBA09 appendix A).
//
//     | U1             W11  0   W13  W14 |  | dc1 |     | gc1 |     m poses, 6 numbers each: U is 6x6
//     |      U2        W21  W22  0   W24 |  | dc2 |     | gc2 |     n points, 3 numbers each: V is 3x3
//     |           U3    0   W32  W33  0  |  | dc3 |     | gc3 |     W is 6x3 and exists where the pose sees
//     | .    .    .    V1                |  | dp1 | = - | gp1 |     the point: a *slot*
//     | .    .    .         V2           |  | dp2 |     | gp2 |
//     | .    .    .              V3      |  | dp3 |     | gp3 |     g = J^T r, and the diagonal is multiplied
//     | .    .    .                   V4 |  | dp4 |     | gp4 |     by 1 + lambda
//
// With V = L L^T (damped), Z = W L^-T and y = L^-1 gp, the points are eliminated:
//
//     S dc = -gc + sum Z y,   S_ij = U_ij - sum Z_i Z_j^T over the points that both i and j see,
//     dp = -L^-T (y + sum Z^T dc)
//
// Memory only grows; between set_structure() and the last solve() nothing is allocated.
class SchurSystem {
 public:
  struct PoseBlock {
    double u[36];        // U by columns, lower triangle
    double gradient[6];  // gc
  };

  // Slots of point p: point_begin[p] <= slot < point_begin[p + 1]; pose_of_slot names the pose of each,
  // ascending and without repetition in a point. point_begin has one more entry than there are points.
  void set_structure(int pose_count, std::span<const int> point_begin, std::span<const int> pose_of_slot);

  int pose_count() const { return pose_count_; }
  int point_count() const { return point_count_; }
  int slot_count() const { return static_cast<int>(pose_of_slot_.size()); }

  void set_zero();
  PoseBlock& pose(int i) { return poses_[i]; }
  PointBlock& point(int p) { return points_[p]; }
  // W, three columns of kCrossRows numbers of which six are used.
  double* cross(int slot) { return &cross_[kCrossSize * static_cast<size_t>(slot)]; }

  // Solves with the diagonal times 1 + damping (an exact zero counts as 1, so that what is not observed
  // stays).
  LmStep solve(double damping);

  // The last solution.
  const double* pose_step(int i) const { return &pose_steps_[6 * static_cast<size_t>(i)]; }
  const double* point_step(int p) const { return &point_steps_[3 * static_cast<size_t>(p)]; }

 private:
  // Pairs [begin, end) of slots belong to one block of the reduced system.
  struct ProductRun {
    int target, begin, end;
  };

  void find_pattern();
  void list_products();
  void sort_products();
  void reduce(double damping);
  void substitute_points();
  double predicted_decrease(double damping) const;

  int pose_count_ = 0, point_count_ = 0;
  std::vector<int> point_begin_, pose_of_slot_;
  std::vector<PoseBlock> poses_;
  std::vector<PointBlock> points_;
  AlignedVector<double> cross_;

  std::vector<int> pattern_begin_, pattern_, slot_begin_, slots_of_pose_, point_of_slot_, marks_;
  std::vector<int> pair_target_, pair_begin_;
  std::vector<SlotPair> listed_pairs_, pairs_;  // before and after sorting by block
  std::vector<ProductRun> runs_;
  BlockCholesky reduced_;
  std::vector<double> factors_;       // per point: L^-1 and y
  AlignedVector<double> scaled_;      // Z per slot, laid out as W
  AlignedVector<double> eliminated_;  // sum of Z y by pose, kCrossRows numbers of which six are used
  std::vector<double> right_;         // right hand side and solution of S, by position
  std::vector<double> pose_steps_, point_steps_;
};

}  // namespace raysfm
