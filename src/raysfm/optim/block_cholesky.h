#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "raysfm/core/paged_memory.h"
#include "raysfm/optim/fill_order.h"
#include "raysfm/optim/work_team.h"

namespace raysfm {

// L L^T of a symmetric positive definite matrix of square blocks, of which a sparse set is not zero.
//
//        0 1 2 3 4 5        analyze() orders the block rows for little fill (+) and gathers neighbouring
//      0 x                  columns of (nearly) the same rows into panels: dense matrices by columns, of
//      1 x x                which the first rows are the diagonal block.
//      2     x
//      3     x x            panel 0: columns 0, 1; rows 0, 1, 4        panel 2: columns 4, 5; rows 4, 5
//      4 x x     x          panel 1: columns 2, 3; rows 2, 3, 5
//      5     x + + x
//
// A panel takes the products of the panels before it (left-looking), then its diagonal is factorised and the
// rows below divided. Positions are those of the order of elimination: position(i) of block row i.
//
// Memory only grows: analyze() of a matrix no larger than an earlier one allocates nothing, factorize() and
// solve() never do. The bits of the result do not depend on the threads.
class BlockCholesky {
 public:
  static constexpr int kDense = 24;  // up to so many block rows, no order and no zero is worth finding

  // Blocks of block_rows x block_rows numbers; 1 <= block_rows <= 16.
  explicit BlockCholesky(int block_rows) : block_rows_(block_rows) {}

  // Pattern: the columns row_begin[i] <= k < row_begin[i + 1] of `columns` are the blocks j != i of row i
  // that are not zero; symmetric, any order, without repetition. Ignored up to kDense block rows.
  void analyze(int size, std::span<const int> row_begin, std::span<const int> columns);

  int size() const { return size_; }
  int position(int block_row) const { return position_[block_row]; }
  size_t value_count() const { return values_.size(); }

  // First number of the block at positions row >= column, which must be in the pattern or in the fill, and
  // the distance of its columns.
  size_t offset(int row, int column) const;
  int stride(int column) const { return panels_[panel_of_[column]].stride; }
  double* values() { return values_.data(); }
  void set_zero();

  // Offsets of all blocks of a column, by position of their row: offsets[row]; those of other rows are left
  // alone. `offsets` has a number for each position.
  void column_offsets(int column, std::span<size_t> offsets) const;

  // Turns the numbers into L; only the lower triangle of a diagonal block is read. False if the matrix is not
  // positive definite (or not finite).
  bool factorize(WorkTeam& team);

  // b = (L L^T)^-1 b, block_rows numbers for each position, after factorize(). `work` has as many numbers.
  void solve(std::span<double> b, std::span<double> work) const;

 private:
  struct Panel {
    int first, columns;  // block columns
    int row_begin;       // into rows_
    int rows;            // block rows, the diagonal ones among them
    int stride;          // numbers
    size_t values;       // into values_
    int update_begin, update_end;
  };
  // Rows [source_row, source_row + rows) of an earlier panel times its rows [column, column + columns) go to
  // the rows from target_row and the columns from target_column of this one. All in blocks from the panel's
  // first.
  struct Update {
    int source, column, columns, target_column;
    int source_row, target_row, rows;
  };

  void find_columns(std::span<const int> row_begin, std::span<const int> columns);
  void order_by_tree();
  void gather_panels();
  void add_panel(int first, int columns);
  void list_updates();
  void list_updates_from(int source);
  bool worth_sharing(const Panel& panel) const;
  void update_rows(const Panel& panel, int begin, int end);
  void divide_rows(const Panel& panel, int begin, int end);

  int block_rows_;
  int size_ = 0;
  FillOrder fill_order_;
  LargeArray<int> position_;   // by block row
  LargeArray<int> block_row_;  // by position

  // By column: the positions of its rows, ascending, the diagonal first; and the tree of elimination.
  LargeArray<int> column_begin_, column_rows_;
  LargeArray<int> first_child_, next_child_, seen_by_, order_, stack_;

  LargeArray<Panel> panels_;
  LargeArray<int> panel_of_;  // by position
  LargeArray<int> rows_;      // positions, panel by panel, ascending
  LargeArray<Update> listed_updates_, updates_;
  LargeArray<int> listed_target_, place_;
  LargeArray<double> values_;
};

}  // namespace raysfm
