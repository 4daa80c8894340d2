#pragma once

namespace raysfm {

// Kernels of PointElimination. The Z of a slot is three columns of `padded` numbers; those
// beyond the rows of a camera block are zero. They take part in every sum, so that the vectors are whole:
// targets and camera numbers have room for kEliminationSlack numbers more. No sum depends on the width of the
// vectors: every instruction set gives the same bits.
inline constexpr int kEliminationSlack = 8;
constexpr int padded_rows(int block) {
  return block <= 8 ? 8 : 12;
}

// A term Z_row Z_column^T: the first numbers of the two Z, counted from the first of all.
struct EliminationPair {
  int row, column;
};

// Z = W L^-T for `slots` slots: of slot s, W and Z are the blocks places[s] of `w` and `z`. `inverse`: L^-1,
// lower by rows (6 numbers).
void scale_point_slots(int padded, int slots, const int* places, const double* inverse, const double* w,
                       double* z);

// right (padded) -= sum of Z y over `count` slots whose Z lie one behind the other; of slot s, y is the 3
// numbers points[s] of `y`.
void subtract_products(int padded, int count, const double* z, const int* points, const double* y,
                       double* right);

// target (padded x columns, by columns `stride` apart) -= sum of the terms. padded: 8 or 12.
void subtract_pairs(int padded, int columns, const double* z, const EliminationPair* pairs, int count,
                    double* target, int stride);

// sum (3 numbers) += Z^T c over the slots, Z the block places[s] of `z`, c the numbers of `numbers` from
// first[s].
void add_transposed(int padded, int slots, const int* first, const int* places, const double* z,
                    const double* numbers, double* sum);

// Numbers of a row of a Jacobian, zeros behind those of its columns.
inline constexpr int kJacobianRow = 16;

// The lower triangle of the first columns of `sum` (kJacobianRow x columns, by columns) += weight J^T J,
// where J has two rows.
void add_outer_products(const double* first_row, const double* second_row, double weight, int columns,
                        double* sum);

}  // namespace raysfm
