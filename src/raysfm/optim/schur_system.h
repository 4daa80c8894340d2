#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/core/paged_memory.h"
#include "raysfm/optim/block_cholesky.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/optim/schur_kernels.h"
#include "raysfm/optim/work_team.h"

namespace raysfm {

// The normal equations of a bundle adjustment and their damped solution (LBA09 appendix A).
//
//     | U1             W11  0   W13  W14 |  | dc1 |     | gc1 |     m poses, N numbers each: U is NxN
//     |      U2        W21  W22  0   W24 |  | dc2 |     | gc2 |     n points, 3 numbers each: V is 3x3
//     |           U3    0   W32  W33  0  |  | dc3 |     | gc3 |     W is Nx3 and exists where the pose sees
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
// Z takes the place of W, which is most of the memory: solve() uses up the slots. N is 6 (a pose) or 9 (a
// pose and a lens). Memory only grows: structures no larger than an earlier one allocate nothing, and solve()
// never does. The bits of the result do not depend on the threads.
template <int N>
class SchurSystem {
 public:
  struct PoseBlock {
    double u[N * N];     // U by columns, lower triangle
    double gradient[N];  // gc
  };

  // Slots of point p: point_begin[p] <= slot < point_begin[p + 1]; pose_of_slot names the pose of each,
  // ascending and without repetition in a point. point_begin has one more entry than there are points.
  void set_structure(int pose_count, std::span<const int> point_begin, std::span<const int> pose_of_slot);

  int pose_count() const { return pose_count_; }
  int point_count() const { return point_count_; }
  int slot_count() const { return static_cast<int>(pose_of_slot_.size()); }

  // set_structure() leaves the numbers unspecified.
  PoseBlock& pose(int i) { return poses_[i]; }
  const PoseBlock& pose(int i) const { return poses_[i]; }
  PointBlock& point(int p) { return points_[p]; }
  const PointBlock& point(int p) const { return points_[p]; }
  // W at cross_place<N>(row, column). After solve(): Z.
  double* cross(int slot) { return &cross_[kCrossSize<N> * static_cast<size_t>(place_of_slot_[slot])]; }
  const double* cross(int slot) const {
    return &cross_[kCrossSize<N> * static_cast<size_t>(place_of_slot_[slot])];
  }
  void set_zero();

  // Solves with the diagonal times 1 + damping (an exact zero counts as 1, so that what is not observed
  // stays). W must have been written since the last solve().
  LmStep solve(double damping, WorkTeam& team);
  // The same with the factors of the last solve(), for other gradients of the poses and points without any:
  // the blocks and the damping must be those of then.
  LmStep solve_again(double damping, WorkTeam& team);

  // The last solution.
  const double* pose_step(int i) const { return &pose_steps_[N * static_cast<size_t>(i)]; }
  const double* point_step(int p) const { return &point_steps_[3 * static_cast<size_t>(p)]; }

  // After solve(): what a point alone would lower the cost by, all else held, by the quadratic model.
  double decrease_of_point(int p) const;
  // After solve(): S^-1 b in place, N numbers by pose.
  void solve_reduced(std::span<double> b);
  // After solve(): L^-1 (6, lower by rows) of a point.
  const double* point_factor(int p) const { return &factors_[kFactorSize * static_cast<size_t>(p)]; }
  std::span<const int> slots_of_pose(int i) const;
  int point_of_slot(int slot) const { return point_of_slot_[slot]; }
  int pose_of_slot(int slot) const { return pose_of_slot_[slot]; }
  int point_begin(int p) const { return point_begin_[p]; }

 private:
  // Pairs [begin, end) of places belong to one block of the reduced system.
  struct ProductRun {
    size_t target, stride;
    int64_t begin, end;
  };

  void list_slots_of_poses();
  void find_pattern();
  void list_products();
  template <typename Use>
  void for_each_pair(int pose, Use use) const;
  void cut_work();
  void eliminate_points(double damping, WorkTeam& team);
  void reduce(double damping, WorkTeam& team);
  void set_right_side(int pose);
  LmStep substitute(double damping, WorkTeam& team);
  void substitute_points(int begin, int end);
  double predicted_decrease(double damping) const;

  int pose_count_ = 0, point_count_ = 0;
  LargeArray<int> point_begin_, pose_of_slot_, point_of_slot_;
  // By pose, the slots ascending; the place of a slot is its place among these.
  LargeArray<int> slot_begin_, slots_of_pose_, points_of_pose_;
  LargeArray<int> place_of_slot_;
  LargeArray<PoseBlock> poses_;
  LargeArray<PointBlock> points_;
  // By place: W, and Z once the points are eliminated. The sums over what two poses see, which are most of
  // the work, so read one stretch of memory for each of the two.
  ScratchArray<double> cross_;

  LargeArray<int> pattern_begin_, pattern_, marks_;
  LargeArray<size_t> offsets_;
  LargeArray<int64_t> place_;
  ScratchArray<PlacePair> pairs_;
  LargeArray<ProductRun> runs_;
  std::vector<int> run_chunks_;  // the runs are shared out in these chunks
  BlockCholesky reduced_{N};
  ScratchArray<double> factors_;  // per point: L^-1 and y
  ScratchArray<double> right_;    // right hand side and solution of S, by position
  ScratchArray<double> work_;
  ScratchArray<double> pose_steps_, point_steps_;
};

extern template class SchurSystem<6>;
extern template class SchurSystem<9>;

}  // namespace raysfm
