#include "raysfm/optim/fill_order.h"

#include <bit>
#include <limits>
#include <numeric>

namespace raysfm {

std::span<const int> FillOrder::minimum_degree(int size, std::span<const int> row_begin,
                                               std::span<const int> columns) {
  order_.resize(size);
  std::iota(order_.begin(), order_.end(), 0);
  if (size > kMostBits) return order_;
  size_ = size;
  words_ = (size + 63) / 64;
  bits_.assign(static_cast<size_t>(size) * words_, 0);
  degree_.resize(size);
  for (int i = 0; i < size; ++i) {
    uint64_t* row = &bits_[static_cast<size_t>(i) * words_];
    degree_[i] = row_begin[i + 1] - row_begin[i];
    for (int k = row_begin[i]; k < row_begin[i + 1]; ++k) {
      row[columns[k] / 64] |= uint64_t{1} << (columns[k] % 64);
    }
  }
  for (int place = 0; place < size; ++place) {
    order_[place] = least_degree();
    eliminate(order_[place]);
  }
  return order_;
}

int FillOrder::least_degree() const {
  int best = -1;
  for (int i = 0; i < size_; ++i) {
    if (degree_[i] >= 0 && (best < 0 || degree_[i] < degree_[best])) best = i;
  }
  return best;
}

// The neighbours of the pivot become neighbours of each other.
void FillOrder::eliminate(int pivot) {
  degree_[pivot] = -1;
  const uint64_t* pivot_row = &bits_[static_cast<size_t>(pivot) * words_];
  for (int w = 0; w < words_; ++w) {
    for (uint64_t rest = pivot_row[w]; rest != 0; rest &= rest - 1) {
      const int i = 64 * w + std::countr_zero(rest);
      uint64_t* row = &bits_[static_cast<size_t>(i) * words_];
      int degree = 0;
      row[pivot / 64] &= ~(uint64_t{1} << (pivot % 64));
      for (int k = 0; k < words_; ++k) {
        row[k] |= pivot_row[k];
        degree += std::popcount(row[k]);
      }
      row[i / 64] &= ~(uint64_t{1} << (i % 64));  // not its own neighbour
      degree_[i] = degree - 1;
    }
  }
}

}  // namespace raysfm
