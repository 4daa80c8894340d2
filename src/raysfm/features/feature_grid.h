#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

namespace raysfm {

// Pixels in square cells, to find those near a place (LBA09 2.1: the region of interest).
class FeatureGrid {
 public:
  static constexpr int kCellShift = 4;  // cells of 16 x 16 pixels

  // width, height: of the image, > 0. Pixels outside it are filed under the nearest cell.
  void build(std::span<const Eigen::Vector2f> pixels, int width, int height);

  int size() const { return static_cast<int>(indices_.size()); }

  // Calls f(index) for every pixel with |pixel - center| <= radius, by cells in scan order and by index
  // within a cell; index refers to the span given to build(). A center or radius that is not finite finds
  // nothing.
  template <typename F>
  void for_each_in(const Eigen::Vector2f& center, float radius, F f) const {
    const Range range = cells_in(center, radius);
    const float radius2 = radius * radius;
    for (int row = range.row_begin; row < range.row_end; ++row) {
      // The cells of a row lie one behind the other, so that one run covers them all.
      const int end = starts_[row * columns_ + range.column_end];
      for (int k = starts_[row * columns_ + range.column_begin]; k < end; ++k) {
        if ((sorted_[k] - center).squaredNorm() <= radius2) f(indices_[k]);
      }
    }
  }

 private:
  struct Range {
    int column_begin = 0, column_end = 0, row_begin = 0, row_end = 0;
  };
  Range cells_in(const Eigen::Vector2f& center, float radius) const;

  int columns_ = 0;
  int rows_ = 0;
  std::vector<int> starts_;  // of each cell in sorted_, and the end of the last
  std::vector<int> indices_;
  std::vector<Eigen::Vector2f> sorted_;  // pixels in the order of indices_
};

}  // namespace raysfm
