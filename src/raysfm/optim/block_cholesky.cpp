#include "raysfm/optim/block_cholesky.h"

#include <algorithm>
#include <numeric>

#include "raysfm/optim/cholesky_kernels.h"

namespace raysfm {
namespace {

constexpr int kMostColumns = 96;  // numbers across a panel: its tiles stay in the cache
constexpr int kTileRows = 96;     // numbers, the unit of work of a thread
constexpr double kMostZeros = 0.15;

}  // namespace

void BlockCholesky::analyze(int size, std::span<const int> row_begin, std::span<const int> columns) {
  size_ = size;
  position_.resize(size);
  block_row_.resize(size);
  column_begin_.resize(size + 1);
  if (size <= kDense) {
    std::iota(position_.begin(), position_.end(), 0);
    block_row_ = position_;
    column_rows_.clear();
    for (int column = 0; column < size; ++column) {
      column_begin_[column] = static_cast<int>(column_rows_.size());
      for (int row = column; row < size; ++row) column_rows_.push_back(row);
    }
    column_begin_[size] = static_cast<int>(column_rows_.size());
  } else {
    const std::span<const int> order = fill_order_.minimum_degree(size, row_begin, columns);
    std::copy(order.begin(), order.end(), block_row_.begin());
    find_columns(row_begin, columns);
    order_by_tree();
    find_columns(row_begin, columns);
  }
  gather_panels();
  list_updates();
}

// The rows of a column of L are those of the matrix and those of every column whose first row below the
// diagonal is this column (its children in the elimination tree).
void BlockCholesky::find_columns(std::span<const int> row_begin, std::span<const int> columns) {
  for (int p = 0; p < size_; ++p) position_[block_row_[p]] = p;
  first_child_.assign(size_, -1);
  next_child_.assign(size_, -1);
  seen_by_.assign(size_, -1);
  column_rows_.clear();
  for (int column = 0; column < size_; ++column) {
    const int begin = column_begin_[column] = static_cast<int>(column_rows_.size());
    column_rows_.push_back(column);
    seen_by_[column] = column;
    const auto add = [&](int row) {
      if (row > column && seen_by_[row] != column) {
        seen_by_[row] = column;
        column_rows_.push_back(row);
      }
    };
    const int i = block_row_[column];
    for (int k = row_begin[i]; k < row_begin[i + 1]; ++k) add(position_[columns[k]]);
    for (int child = first_child_[column]; child >= 0; child = next_child_[child]) {
      for (int k = column_begin_[child]; k < column_begin_[child + 1]; ++k) add(column_rows_[k]);
    }
    std::sort(column_rows_.begin() + begin + 1, column_rows_.end());
    if (column_rows_.size() - begin > 1) {
      const int parent = column_rows_[begin + 1];
      next_child_[column] = first_child_[parent];
      first_child_[parent] = column;
    }
  }
  column_begin_[size_] = static_cast<int>(column_rows_.size());
}

// Children right before their parent (postorder): the fill is the same, and columns of the same rows become
// neighbours.
void BlockCholesky::order_by_tree() {
  order_.clear();
  const auto is_root = [&](int column) { return column_begin_[column + 1] - column_begin_[column] == 1; };
  for (int root = size_ - 1; root >= 0; --root) {
    if (!is_root(root)) continue;
    stack_.assign(1, root);
    while (!stack_.empty()) {  // parents before their children, from the end
      const int column = stack_.back();
      stack_.pop_back();
      order_.push_back(block_row_[column]);
      for (int child = first_child_[column]; child >= 0; child = next_child_[child]) stack_.push_back(child);
    }
  }
  std::reverse_copy(order_.begin(), order_.end(), block_row_.begin());
}

void BlockCholesky::gather_panels() {
  panels_.clear();
  rows_.clear();
  panel_of_.resize(size_);
  const int most = std::max(1, kMostColumns / block_rows_);
  const auto rows_of = [&](int column) { return column_begin_[column + 1] - column_begin_[column]; };
  for (int first = 0; first < size_;) {
    int next = first + 1, used = rows_of(first);  // used: blocks that may be other than zero
    while (next < size_ && next - first < most && rows_of(next - 1) > 1 &&
           column_rows_[column_begin_[next - 1] + 1] == next) {
      // The panel's columns take over the rows of `next`.
      const int columns = next + 1 - first;
      const int blocks = columns * rows_of(next) + columns * (columns - 1) / 2;
      if (blocks - (used + rows_of(next)) > kMostZeros * blocks) break;
      used += rows_of(next);
      ++next;
    }
    add_panel(first, next - first);
    first = next;
  }
  size_t count = 0;
  for (Panel& panel : panels_) {
    panel.values = count;
    count += static_cast<size_t>(panel.stride) * panel.columns * block_rows_;
  }
  values_.resize(count + kKernelSlack);
}

void BlockCholesky::add_panel(int first, int columns) {
  const int last = first + columns - 1;
  Panel panel{};
  panel.first = first, panel.columns = columns;
  panel.row_begin = static_cast<int>(rows_.size());
  for (int c = first; c < last; ++c) rows_.push_back(c);
  rows_.insert(rows_.end(), column_rows_.begin() + column_begin_[last],
               column_rows_.begin() + column_begin_[last + 1]);
  panel.rows = static_cast<int>(rows_.size()) - panel.row_begin;
  panel.stride = (panel.rows * block_rows_ + 7) / 8 * 8;
  if (panel.stride % 128 == 0) panel.stride += 8;  // or the columns compete for the same lines of the cache
  for (int c = first; c <= last; ++c) panel_of_[c] = static_cast<int>(panels_.size());
  panels_.push_back(panel);
}

void BlockCholesky::list_updates() {
  listed_updates_.clear();
  listed_target_.clear();
  for (size_t source = 0; source < panels_.size(); ++source) list_updates_from(static_cast<int>(source));
  place_.assign(panels_.size() + 1, 0);
  for (int target : listed_target_) ++place_[target + 1];
  for (size_t k = 0; k < panels_.size(); ++k) {
    place_[k + 1] += place_[k];
    panels_[k].update_begin = place_[k], panels_[k].update_end = place_[k + 1];
  }
  updates_.resize(listed_updates_.size());
  for (size_t k = 0; k < listed_updates_.size(); ++k)
    updates_[place_[listed_target_[k]]++] = listed_updates_[k];
}

// One update for each panel that owns rows of the source, cut where the rows do not follow each other in
// both. The columns of an update follow each other in both: panels own columns without gaps, but the source
// may not have all of them.
void BlockCholesky::list_updates_from(int source) {
  const Panel& from = panels_[source];
  const int* rows = &rows_[from.row_begin];
  for (int column = from.columns; column < from.rows;) {
    const int target = panel_of_[rows[column]];
    const Panel& to = panels_[target];
    const int* target_rows = &rows_[to.row_begin];
    int column_end = column + 1;
    while (column_end < from.rows && rows[column_end] == rows[column_end - 1] + 1 &&
           panel_of_[rows[column_end]] == target) {
      ++column_end;
    }
    int target_row = rows[column] - to.first;
    for (int row = column; row < from.rows;) {
      while (target_rows[target_row] != rows[row]) ++target_row;
      int count = 1;
      while (row + count < from.rows && target_row + count < to.rows &&
             rows[row + count] == target_rows[target_row + count]) {
        ++count;
      }
      listed_updates_.push_back(
          {source, column, column_end - column, rows[column] - to.first, row, target_row, count});
      listed_target_.push_back(target);
      row += count;
    }
    column = column_end;
  }
}

size_t BlockCholesky::offset(int row, int column) const {
  const Panel& panel = panels_[panel_of_[column]];
  const auto begin = rows_.begin() + panel.row_begin, end = begin + panel.rows;
  const size_t place = std::lower_bound(begin, end, row) - begin;
  return panel.values + static_cast<size_t>(panel.stride) * block_rows_ * (column - panel.first) +
         place * block_rows_;
}

void BlockCholesky::column_offsets(int column, std::span<size_t> offsets) const {
  const Panel& panel = panels_[panel_of_[column]];
  const size_t first =
      panel.values + static_cast<size_t>(panel.stride) * block_rows_ * (column - panel.first);
  for (int k = 0; k < panel.rows; ++k) {
    offsets[rows_[panel.row_begin + k]] = first + static_cast<size_t>(k) * block_rows_;
  }
}

void BlockCholesky::set_zero() {
  std::fill(values_.begin(), values_.end(), 0.0);
}

bool BlockCholesky::factorize(WorkTeam& team) {
  for (const Panel& panel : panels_) {
    const int rows = panel.rows * block_rows_, columns = panel.columns * block_rows_;
    const bool share = worth_sharing(panel);
    const int tile = share ? kTileRows : rows;
    const auto tiles = [&](int from) { return (rows - from + tile - 1) / tile; };
    const auto each = [&](int from, auto work) {
      const auto body = [&](int i) { work(from + i * tile, std::min(rows, from + (i + 1) * tile)); };
      if (share) {
        team.run(tiles(from), body);
      } else {
        for (int i = 0; i < tiles(from); ++i) body(i);
      }
    };
    each(0, [&](int begin, int end) { update_rows(panel, begin, end); });
    if (!factorize_dense(columns, &values_[panel.values], panel.stride)) return false;
    each(columns, [&](int begin, int end) { divide_rows(panel, begin, end); });
  }
  return true;
}

// Waking threads costs some microseconds.
bool BlockCholesky::worth_sharing(const Panel& panel) const {
  constexpr double kLeastProducts = 2e5;
  const double columns = panel.columns * block_rows_, rows = panel.rows * block_rows_;
  double products = rows * columns * columns;
  for (int u = panel.update_begin; u < panel.update_end; ++u) {
    const Update& update = updates_[u];
    products += double(update.rows) * update.columns * panels_[update.source].columns * block_rows_ *
                block_rows_ * block_rows_;
  }
  return products > kLeastProducts && rows > kTileRows;
}

// Rows [begin, end), in numbers, of the panel take all updates. The sum for each number does not depend on
// where the rows are cut.
void BlockCholesky::update_rows(const Panel& panel, int begin, int end) {
  for (int u = panel.update_begin; u < panel.update_end; ++u) {
    const Update& update = updates_[u];
    const Panel& source = panels_[update.source];
    const int first = std::max(begin, update.target_row * block_rows_);
    const int last = std::min(end, (update.target_row + update.rows) * block_rows_);
    if (first >= last) continue;
    const int source_row = first + (update.source_row - update.target_row) * block_rows_;
    const size_t stride = source.stride;
    subtract_product(last - first, update.columns * block_rows_, source.columns * block_rows_,
                     &values_[source.values + source_row], stride,
                     &values_[source.values + static_cast<size_t>(update.column) * block_rows_], stride,
                     &values_[panel.values + first +
                              static_cast<size_t>(update.target_column) * block_rows_ * panel.stride],
                     panel.stride);
  }
}

void BlockCholesky::divide_rows(const Panel& panel, int begin, int end) {
  double* values = &values_[panel.values];
  divide_by_transposed(end - begin, panel.columns * block_rows_, values, panel.stride, values + begin,
                       panel.stride);
}

void BlockCholesky::solve(std::span<double> b, std::span<double> work) const {
  const auto below = [&](const Panel& panel, auto move) {
    for (int k = panel.columns; k < panel.rows; ++k) {
      double* x = &b[static_cast<size_t>(block_rows_) * rows_[panel.row_begin + k]];
      move(x, &work[static_cast<size_t>(block_rows_) * (k - panel.columns)]);
    }
  };
  for (const Panel& panel : panels_) {
    const int columns = panel.columns * block_rows_, rest = panel.rows * block_rows_ - columns;
    const double* l = &values_[panel.values];
    const size_t stride = panel.stride;
    double* x = &b[static_cast<size_t>(block_rows_) * panel.first];
    for (int c = 0; c < columns; ++c) {
      x[c] /= l[c * stride + c];
      for (int r = c + 1; r < columns; ++r) x[r] -= l[c * stride + r] * x[c];
    }
    if (rest == 0) continue;
    below(panel, [&](double* from, double* to) { std::copy_n(from, block_rows_, to); });
    subtract_product_with_vector(rest, columns, l + columns, stride, x, work.data());
    below(panel, [&](double* to, double* from) { std::copy_n(from, block_rows_, to); });
  }
  for (size_t p = panels_.size(); p-- > 0;) {
    const Panel& panel = panels_[p];
    const int columns = panel.columns * block_rows_, rest = panel.rows * block_rows_ - columns;
    const double* l = &values_[panel.values];
    const size_t stride = panel.stride;
    double* x = &b[static_cast<size_t>(block_rows_) * panel.first];
    if (rest > 0) {
      below(panel, [&](double* from, double* to) { std::copy_n(from, block_rows_, to); });
      subtract_transposed_product_with_vector(rest, columns, l + columns, stride, work.data(), x);
    }
    for (int c = columns - 1; c >= 0; --c) {
      for (int r = c + 1; r < columns; ++r) x[c] -= l[c * stride + r] * x[r];
      x[c] /= l[c * stride + c];
    }
  }
}

}  // namespace raysfm
