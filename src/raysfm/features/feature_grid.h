#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace raysfm {

// Pixels in square cells, to find those near a place (LBA09 2.1: the region of interest).
class FeatureGrid {
 public:
  // Pixels [begin, end) of `pixels`, in cells of 16 x 16 pixels of an octave. width, height: of the image,
  // > 0. Pixels outside it are filed under the nearest cell.
  void build(std::span<const Eigen::Vector2f> pixels, int begin, int end, int width, int height,
             int octave = 0);
  void build(std::span<const Eigen::Vector2f> pixels, int width, int height) {
    build(pixels, 0, static_cast<int>(pixels.size()), width, height);
  }

  int size() const { return size_; }

  // Calls f(index) for every pixel with |pixel - center| <= radius, by cells in scan order and by index
  // within a cell; index refers to the span given to build(). A center or radius that is not finite finds
  // nothing.
  template <typename F>
  void for_each_in(const Eigen::Vector2f& center, float radius, F f) const {
    const float radius2 = radius * radius;
    for_each_run(center, radius, [&](int begin, int end) {
      for (int k = begin; k < end; ++k) {
        const float dx = xs_[k] - center.x(), dy = ys_[k] - center.y();
        if (dx * dx + dy * dy <= radius2) f(indices_[k]);
      }
    });
  }

  // For inner loops: calls f(begin, end) for the runs of places in xs(), ys() and indices() that hold all
  // these pixels, and others near them. The cells of one row lie one behind the other, so that one run covers
  // them.
  template <typename F>
  void for_each_run(const Eigen::Vector2f& center, float radius, F f) const {
    const Range range = cells_in(center, radius);
    for (int row = range.row_begin; row < range.row_end; ++row) {
      const int* starts = starts_.data() + row * columns_;
      f(starts[range.column_begin], starts[range.column_end]);
    }
  }

  // Behind the last of each of the following, so many more may be read, for whole vectors; they are of no
  // pixel.
  static constexpr int kBeyond = 64;
  // Pixels by cell, and their indices in the span given to build().
  const float* xs() const { return xs_.data(); }
  const float* ys() const { return ys_.data(); }
  const int* indices() const { return indices_.data(); }

 private:
  struct Range {
    int column_begin = 0, column_end = 0, row_begin = 0, row_end = 0;
  };
  Range cells_in(const Eigen::Vector2f& center, float radius) const;

  int cell_shift_ = 4;  // of the side of a cell
  int columns_ = 0;
  int rows_ = 0;
  int size_ = 0;
  std::vector<int> starts_;  // of each cell in indices_, and the end of the last
  std::vector<int> indices_;
  std::vector<float> xs_, ys_;
};

}  // namespace raysfm
