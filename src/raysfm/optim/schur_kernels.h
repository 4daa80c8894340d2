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

// V (xx, xy, xz, yy, yz, zz) and gp of a point.
struct PointBlock {
  double v[6];
  double gradient[3];
};

// Of each point, for the damped V = L L^T: L^-1 (6, lower by rows) and y = L^-1 gp (3). `factors` must have
// room for kFactorSize numbers for each point, the number of points rounded up to a multiple of eight. A
// point that one ray alone holds has a pivot as small as the damping; a floor keeps rounding from making it
// negative. A diagonal of zero counts as one for the damping.
inline constexpr int kFactorSize = 9;
void factorize_points(const PointBlock* points, int count, double damping, double* factors);

// For every slot s of point p, point_begin[p] <= s < point_begin[p + 1]: Z_s = W_s L^-T, and Z_s y is added
// to the eight numbers of `right` of the slot's pose. `factors` holds L^-1 (6, lower by rows) and y (3) of
// each point.
void scale_slots(int point_count, const int* point_begin, const int* pose_of_slot, const double* factors,
                 const double* w, double* z, double* right);

// target (6x6 by columns) -= sum of the products of the pairs.
void subtract_products(const double* z, const SlotPair* pairs, int count, double* target);

}  // namespace raysfm
