#include "raysfm/optim/block_cholesky.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace raysfm {
namespace {

constexpr int kRows = 6;

// Blocks are stored by columns: element (r, c) is at [6 c + r].

// C -= A B^T.
void subtract_product(const double* a, const double* b, double* c) {
  for (int col = 0; col < kRows; ++col) {
    for (int row = 0; row < kRows; ++row) {
      double sum = 0;
      for (int k = 0; k < kRows; ++k) sum += a[kRows * k + row] * b[kRows * k + col];
      c[kRows * col + row] -= sum;
    }
  }
}

// y -= A x.
void subtract_product_with_vector(const double* a, const double* x, double* y) {
  for (int k = 0; k < kRows; ++k) {
    for (int row = 0; row < kRows; ++row) y[row] -= a[kRows * k + row] * x[k];
  }
}

// y -= A^T x.
void subtract_transposed_product_with_vector(const double* a, const double* x, double* y) {
  for (int k = 0; k < kRows; ++k) {
    double sum = 0;
    for (int row = 0; row < kRows; ++row) sum += a[kRows * k + row] * x[row];
    y[k] -= sum;
  }
}

// a (6x6, lower triangle) becomes its Cholesky factor.
bool factorize_diagonal(double* a) {
  for (int c = 0; c < kRows; ++c) {
    const double pivot = a[kRows * c + c];
    if (!(pivot > 0) || !std::isfinite(pivot)) return false;
    const double root = std::sqrt(pivot);
    const double inverse = 1.0 / root;
    a[kRows * c + c] = root;
    for (int r = c + 1; r < kRows; ++r) a[kRows * c + r] *= inverse;
    for (int k = c + 1; k < kRows; ++k) {
      const double factor = a[kRows * c + k];
      for (int r = k; r < kRows; ++r) a[kRows * k + r] -= factor * a[kRows * c + r];
    }
  }
  return true;
}

// b (6x6) becomes b L^-T.
void divide_by_transposed(const double* l, double* b) {
  for (int c = 0; c < kRows; ++c) {
    const double inverse = 1.0 / l[kRows * c + c];
    for (int r = 0; r < kRows; ++r) b[kRows * c + r] *= inverse;
    for (int k = c + 1; k < kRows; ++k) {
      const double factor = l[kRows * c + k];
      for (int r = 0; r < kRows; ++r) b[kRows * k + r] -= factor * b[kRows * c + r];
    }
  }
}

}  // namespace

void BlockCholesky::analyze(int size, std::span<const int> row_begin, std::span<const int> columns) {
  size_ = size;
  position_.resize(size);
  block_row_.resize(size);
  if (size <= kDense) {
    analyze_dense();
  } else {
    order(row_begin, columns);
    add_fill(row_begin, columns);
  }
  values_.resize(36 * rows_.size());
}

void BlockCholesky::analyze_dense() {
  std::iota(position_.begin(), position_.end(), 0);
  block_row_ = position_;
  column_begin_.resize(size_ + 1);
  rows_.clear();
  rows_.reserve(kDense * (kDense + 1) / 2);
  for (int column = 0; column < size_; ++column) {
    column_begin_[column] = static_cast<int>(rows_.size());
    for (int row = column; row < size_; ++row) rows_.push_back(row);
  }
  column_begin_[size_] = static_cast<int>(rows_.size());
}

void BlockCholesky::order(std::span<const int> row_begin, std::span<const int> columns) {
  Eigen::SparseMatrix<double> pattern(size_, size_);
  Eigen::VectorXi counts(size_);
  for (int i = 0; i < size_; ++i) counts[i] = row_begin[i + 1] - row_begin[i] + 1;
  pattern.reserve(counts);
  for (int i = 0; i < size_; ++i) {
    pattern.insert(i, i) = 1.0;
    for (int k = row_begin[i]; k < row_begin[i + 1]; ++k) pattern.insert(columns[k], i) = 1.0;
  }
  pattern.makeCompressed();
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> permutation;
  Eigen::AMDOrdering<int>()(pattern, permutation);
  for (int p = 0; p < size_; ++p) {
    block_row_[p] = permutation.indices()[p];
    position_[block_row_[p]] = p;
  }
}

// The rows of a column of L are those of the matrix and those of every column whose first row below the
// diagonal is this column (its children in the elimination tree).
void BlockCholesky::add_fill(std::span<const int> row_begin, std::span<const int> columns) {
  std::vector<int> first_child(size_, -1), next_child(size_, -1), seen_by(size_, -1);
  column_begin_.assign(1, 0);
  rows_.clear();
  for (int column = 0; column < size_; ++column) {
    rows_.push_back(column);
    seen_by[column] = column;
    const auto add = [&](int row) {
      if (row > column && seen_by[row] != column) {
        seen_by[row] = column;
        rows_.push_back(row);
      }
    };
    const int i = block_row_[column];
    for (int k = row_begin[i]; k < row_begin[i + 1]; ++k) add(position_[columns[k]]);
    for (int child = first_child[column]; child >= 0; child = next_child[child]) {
      for (int k = column_begin_[child]; k < column_begin_[child + 1]; ++k) add(rows_[k]);
    }
    std::sort(rows_.begin() + column_begin_[column] + 1, rows_.end());
    column_begin_.push_back(static_cast<int>(rows_.size()));
    if (column_begin_[column + 1] - column_begin_[column] > 1) {
      const int parent = rows_[column_begin_[column] + 1];
      next_child[column] = first_child[parent];
      first_child[parent] = column;
    }
  }
}

int BlockCholesky::find(int row, int column) const {
  const auto begin = rows_.begin() + column_begin_[column], end = rows_.begin() + column_begin_[column + 1];
  return static_cast<int>(std::lower_bound(begin, end, row) - rows_.begin());
}

void BlockCholesky::set_zero() {
  std::fill(values_.begin(), values_.end(), 0.0);
}

bool BlockCholesky::factorize() {
  for (int column = 0; column < size_; ++column) {
    double* diagonal = block(column_begin_[column]);
    if (!factorize_diagonal(diagonal)) return false;
    for (int k = column_begin_[column] + 1; k < column_begin_[column + 1]; ++k) {
      divide_by_transposed(diagonal, block(k));
    }
    update_right_of(column);
  }
  return true;
}

void BlockCholesky::update_right_of(int column) {
  const int end = column_begin_[column + 1];
  for (int j = column_begin_[column] + 1; j < end; ++j) {
    int target = column_begin_[rows_[j]];
    for (int i = j; i < end; ++i) {
      while (rows_[target] != rows_[i]) ++target;  // the fill makes every row of `column` a row of column j
      subtract_product(block(i), block(j), block(target));
    }
  }
}

void BlockCholesky::solve(std::span<double> b) const {
  for (int column = 0; column < size_; ++column) {
    const double* diagonal = &values_[size_t(36) * column_begin_[column]];
    double* x = &b[size_t(kRows) * column];
    for (int c = 0; c < kRows; ++c) {
      x[c] /= diagonal[kRows * c + c];
      for (int r = c + 1; r < kRows; ++r) x[r] -= diagonal[kRows * c + r] * x[c];
    }
    for (int k = column_begin_[column] + 1; k < column_begin_[column + 1]; ++k) {
      subtract_product_with_vector(&values_[size_t(36) * k], x, &b[size_t(kRows) * rows_[k]]);
    }
  }
  for (int column = size_ - 1; column >= 0; --column) {
    const double* diagonal = &values_[size_t(36) * column_begin_[column]];
    double* x = &b[size_t(kRows) * column];
    for (int k = column_begin_[column] + 1; k < column_begin_[column + 1]; ++k) {
      subtract_transposed_product_with_vector(&values_[size_t(36) * k], &b[size_t(kRows) * rows_[k]], x);
    }
    for (int c = kRows - 1; c >= 0; --c) {
      for (int r = c + 1; r < kRows; ++r) x[c] -= diagonal[kRows * c + r] * x[r];
      x[c] /= diagonal[kRows * c + c];
    }
  }
}

}  // namespace raysfm
