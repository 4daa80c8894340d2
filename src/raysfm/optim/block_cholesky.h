#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace raysfm {

// L L^T of a symmetric positive definite matrix of 6x6 blocks, of which a sparse set is not zero.
//
//        0  1  2  3  4          The blocks of the lower triangle are kept by columns, the diagonal first,
//        each
//      0 x                      stored by columns. analyze() orders the block columns for little fill and
//      adds 1    x                   the fill (+); the numbers are written into the same blocks that
//      factorize() 2 x     x                turns into L. 3    x     x 4 x  x  +  +  x          Positions are
//      those of the order of elimination: position(i) of block row i.
//
// Memory only grows. factorize() and solve() do not allocate, and analyze() does not up to kDense block rows
// once it has seen as many.
class BlockCholesky {
 public:
  static constexpr int kDense = 24;  // up to so many block rows, no order and no zero is worth finding

  // Pattern: the columns row_begin[i] <= k < row_begin[i + 1] of `columns` are the blocks j != i of row i
  // that are not zero; symmetric, any order, without repetition. Ignored up to kDense block rows.
  void analyze(int size, std::span<const int> row_begin, std::span<const int> columns);

  int size() const { return size_; }
  int position(int block_row) const { return position_[block_row]; }
  size_t block_count() const { return rows_.size(); }

  // Index of the block at positions row >= column, which must be in the pattern.
  int find(int row, int column) const;
  int diagonal(int position) const { return column_begin_[position]; }
  double* block(int index) { return &values_[size_t(36) * index]; }
  void set_zero();

  // Turns the numbers into L; only the lower triangle of a diagonal block is read. False if the matrix is not
  // positive definite (or not finite).
  bool factorize();

  // b = (L L^T)^-1 b, 6 numbers for each position, after factorize().
  void solve(std::span<double> b) const;

 private:
  void analyze_dense();
  void order(std::span<const int> row_begin, std::span<const int> columns);
  void add_fill(std::span<const int> row_begin, std::span<const int> columns);
  void update_right_of(int column);

  int size_ = 0;
  std::vector<int> position_;      // by block row
  std::vector<int> block_row_;     // by position
  std::vector<int> column_begin_;  // by position, size_ + 1
  std::vector<int> rows_;          // positions, ascending in a column, the diagonal first
  std::vector<double> values_;     // 36 for each of rows_
};

}  // namespace raysfm
