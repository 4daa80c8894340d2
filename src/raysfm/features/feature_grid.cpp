#include "raysfm/features/feature_grid.h"

#include <cmath>

namespace raysfm {
namespace {

// Cell of a coordinate, 0 to cells - 1. Written so that a NaN gives 0.
int cell_of(float coordinate, int shift, int cells) {
  const float cell = coordinate / static_cast<float>(1 << shift);
  if (!(cell > 0)) return 0;
  return cell >= static_cast<float>(cells) ? cells - 1 : static_cast<int>(cell);
}

}  // namespace

void FeatureGrid::build(std::span<const Eigen::Vector2f> pixels, int begin, int end, int width, int height,
                        int octave) {
  constexpr int kCellShift = 4;
  cell_shift_ = kCellShift + octave;
  columns_ = (width >> cell_shift_) + 1;
  rows_ = (height >> cell_shift_) + 1;
  const auto cell = [&](const Eigen::Vector2f& p) {
    return cell_of(p.y(), cell_shift_, rows_) * columns_ + cell_of(p.x(), cell_shift_, columns_);
  };
  // Counted two places on, so that after filling, starts_[c] is where cell c begins.
  starts_.assign(static_cast<size_t>(columns_) * rows_ + 2, 0);
  for (int i = begin; i < end; ++i) ++starts_[cell(pixels[i]) + 2];
  for (size_t c = 2; c < starts_.size(); ++c) starts_[c] += starts_[c - 1];
  size_ = end - begin;
  indices_.resize(size_ + kBeyond);
  xs_.resize(size_ + kBeyond);
  ys_.resize(size_ + kBeyond);
  for (int i = begin; i < end; ++i) {
    const int place = starts_[cell(pixels[i]) + 1]++;
    indices_[place] = i;
    xs_[place] = pixels[i].x();
    ys_[place] = pixels[i].y();
  }
}

FeatureGrid::Range FeatureGrid::cells_in(const Eigen::Vector2f& center, float radius) const {
  const bool finite = std::isfinite(center.x()) && std::isfinite(center.y()) && std::isfinite(radius);
  if (!finite || radius < 0 || size_ == 0) return {};
  return {cell_of(center.x() - radius, cell_shift_, columns_),
          cell_of(center.x() + radius, cell_shift_, columns_) + 1,
          cell_of(center.y() - radius, cell_shift_, rows_),
          cell_of(center.y() + radius, cell_shift_, rows_) + 1};
}

}  // namespace raysfm
