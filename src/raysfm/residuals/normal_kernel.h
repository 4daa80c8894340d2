#pragma once

#include "raysfm/residuals/observation_block.h"

namespace raysfm {

// Sums over the blocks of one pose, lane by lane, so that they do not depend on the width of the vectors: the
// lower triangle of U and gc, in the order of add_pose_sums().
template <int N>
struct alignas(64) PoseSums {
  double sum[N * (N + 1) / 2 + N][kBlockLanes];
};

// R by rows. N is 6 or 9.

// x, the point in the world, becomes R x + t.
void transform_points(const double* rotation, const double* translation, ResidualBlock* block);

// Fills `point`.
template <int N>
void point_terms(const double* rotation, ObservationBlock<N>* block);

// Adds the pose side to `sums`.
void pose_terms(const ObservationBlock<6>& block, PoseSums<6>* sums);

// Fills `point` and `cross` and adds the pose side to `sums`.
template <int N>
void point_and_pose_terms(const double* rotation, ObservationBlock<N>* block, PoseSums<N>* sums);

// Adds the sums over all lanes to U (NxN by columns, lower triangle) and gc.
template <int N>
void add_pose_sums(const PoseSums<N>& sums, double* u, double* gradient);

}  // namespace raysfm
