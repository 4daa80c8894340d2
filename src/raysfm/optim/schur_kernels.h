#pragma once

#include <cstddef>

namespace raysfm {

// A block of the points' elimination, N rows (6 or 9, the unknowns of a pose) by 3 columns, is kept by
// columns: of six rows without gaps, which a map of a whole video is large for; of nine rows the first eight,
// so that a column is whole vectors, and the ninth row follows.
template <int N>
inline constexpr int kCrossRows = N == 9 ? 8 : 6;
template <int N>
inline constexpr int kCrossSize = N == 9 ? 32 : 18;
template <int N>
constexpr int cross_place(int row, int column) {
  return row < kCrossRows<N> ? kCrossRows<N> * column + row : 3 * kCrossRows<N> + column;
}
// Numbers behind the last block that are read, and of no effect.
inline constexpr int kCrossBeyond = 8;

// Z_row Z_column^T, one term of a block of the reduced system.
struct PlacePair {
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

// For every slot s of point p, begin <= p < end, point_begin[p] <= s < point_begin[p + 1]: W of its place
// becomes Z = W L^-T.
template <int N>
void scale_slots(int begin, int end, const int* point_begin, const int* place_of_slot, const double* factors,
                 double* cross);

// right (N) += sum of Z y over `count` blocks Z, `points` naming the point of each.
template <int N>
void add_right_side(const double* z, const double* factors, const int* points, int count, double* right);

// target (N x N by columns of this stride) -= sum of the products of the pairs.
template <int N>
void subtract_products(const double* z, const PlacePair* pairs, int count, double* target, size_t stride);

}  // namespace raysfm
