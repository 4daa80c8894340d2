#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/core/paged_memory.h"

namespace raysfm {

// An order of elimination with little fill: minimum degree on the graph of a symmetric pattern. Exact degrees
// on rows of bits: n^2 / 8 bytes, which for the blocks of a bundle adjustment is less than one column of
// numbers of each. Beyond kMostBits rows the order stays that of the caller, which for the poses of a
// sequence is good as well. Memory only grows.
class FillOrder {
 public:
  static constexpr int kMostBits = 32768;

  // The columns row_begin[i] <= k < row_begin[i + 1] of `columns` are the j != i that are not zero in row i;
  // symmetric. Returns, by place in the order, the row that is eliminated there. Valid until the next call.
  std::span<const int> minimum_degree(int size, std::span<const int> row_begin, std::span<const int> columns);

 private:
  int least_degree() const;
  void eliminate(int pivot);

  int size_ = 0, words_ = 0;
  LargeArray<uint64_t> bits_;  // neighbours that are not yet eliminated, by row
  std::vector<int> degree_, order_;
};

}  // namespace raysfm
