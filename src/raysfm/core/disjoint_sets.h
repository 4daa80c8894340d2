#pragma once

#include <algorithm>
#include <numeric>
#include <vector>

namespace raysfm {

// Sets of the numbers from 0 to count - 1, each of its own until they are joined. The smallest number of a
// set stands for it.
class DisjointSets {
 public:
  explicit DisjointSets(size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }

  // The number that stands for the set of `i`.
  int root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(int i, int j) {
    i = root(i), j = root(j);
    parent_[std::max(i, j)] = std::min(i, j);
  }

 private:
  std::vector<int> parent_;
};

}  // namespace raysfm
