#pragma once

namespace raysfm {

// 6x3 blocks of the points' elimination are kept by columns of eight numbers, the last two of each zero, so
// that a column is whole vectors.
inline constexpr int kCrossRows = 8;
inline constexpr int kCrossSize = 3 * kCrossRows;

// Z_row Z_column^T, one term of a block of the reduced system.
struct SlotPair {
  int row, column;
};

// For every slot s of point p, point_begin[p] <= s < point_begin[p + 1]: Z_s = W_s L^-T, and Z_s y is added
// to the eight numbers of `right` of the slot's pose. `factors` holds L^-1 (6, lower by rows) and y (3) of
// each point.
void scale_slots(int point_count, const int* point_begin, const int* pose_of_slot, const double* factors,
                 const double* w, double* z, double* right);

// target (6x6 by columns) -= sum of the products of the pairs.
void subtract_products(const double* z, const SlotPair* pairs, int count, double* target);

}  // namespace raysfm
