#include "raysfm/camera/pixel_curvature.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <utility>

namespace raysfm {
namespace {

constexpr int kCells = 128;  // along each axis, at most one for each pixel
constexpr int kGaps = 3;     // nodes that may lie between one that sees nothing and one that is known

// Directions of rays at the nodes of a table, and at one more on each side.
class RayGrid {
 public:
  RayGrid(const Camera& camera, int columns, int rows, const Eigen::Vector2d& spacing)
      : columns_(columns), spacing_(spacing), directions_((columns + 2) * (rows + 2)) {
    for (int row = -1; row <= rows; ++row) {
      for (int column = -1; column <= columns; ++column) {
        Ray ray;
        const Eigen::Vector2d pixel(column * spacing.x() - 0.5, row * spacing.y() - 0.5);
        Eigen::Vector3d& direction = directions_[index(column, row)];
        direction.setZero();
        if (!camera.ray(pixel, &ray)) continue;
        direction = ray.direction;
        origins_ += ray.origin;
        ++rays_;
      }
    }
  }

  Eigen::Vector3d mean_origin() const { return origins_ / std::max(rays_, 1); }

  // False where the node or a neighbour sees nothing.
  bool symbols(int column, int row, Eigen::Matrix<float, 2, 3>* symbols) const {
    std::array<Eigen::Vector3d, 9> d;
    for (int i = 0; i < 9; ++i) {
      d[i] = directions_[index(column + i % 3 - 1, row + i / 3 - 1)];
      if (d[i].isZero()) return false;
    }
    Eigen::Matrix<double, 3, 2> first;
    first << (d[5] - d[3]) / (2 * spacing_.x()), (d[7] - d[1]) / (2 * spacing_.y());
    Eigen::Matrix3d second;
    second << (d[5] - 2 * d[4] + d[3]) / (spacing_.x() * spacing_.x()),
        (d[8] - d[6] - d[2] + d[0]) / (4 * spacing_.x() * spacing_.y()),
        (d[7] - 2 * d[4] + d[1]) / (spacing_.y() * spacing_.y());
    const Eigen::Matrix2d metric = first.transpose() * first;
    *symbols = (metric.inverse() * first.transpose() * second).cast<float>();
    return symbols->allFinite();
  }

 private:
  size_t index(int column, int row) const {
    return static_cast<size_t>(row + 1) * (columns_ + 2) + column + 1;
  }

  int columns_;
  Eigen::Vector2d spacing_;
  std::vector<Eigen::Vector3d> directions_;            // zero where nothing is seen
  Eigen::Vector3d origins_ = Eigen::Vector3d::Zero();  // their sum
  int rays_ = 0;
};

}  // namespace

PixelCurvature::PixelCurvature(const Camera& camera)
    : columns_(std::clamp(camera.width, 1, kCells) + 1), rows_(std::clamp(camera.height, 1, kCells) + 1) {
  spacing_ = {camera.width / (columns_ - 1.0), camera.height / (rows_ - 1.0)};
  table_.assign(static_cast<size_t>(columns_) * rows_, Symbols::Zero());
  std::vector<uint8_t> known(table_.size());
  const RayGrid grid(camera, columns_, rows_, spacing_);
  for (int i = 0; i < static_cast<int>(table_.size()); ++i) {
    known[i] = grid.symbols(i % columns_, i / columns_, &table_[i]);
    if (!known[i]) table_[i].setZero();
  }
  fill_gaps(std::move(known));
  centre_ = grid.mean_origin();
}

// The mean of neighbours that are known, from those at the border of what is seen outwards.
void PixelCurvature::fill_gaps(std::vector<uint8_t> known) {
  for (int pass = 0; pass < kGaps; ++pass) {
    const std::vector<uint8_t> before = known;
    for (int i = 0; i < static_cast<int>(table_.size()); ++i) {
      if (before[i]) continue;
      const int column = i % columns_, row = i / columns_;
      int count = 0;
      Symbols sum = Symbols::Zero();
      for (int y = std::max(0, row - 1); y <= std::min(rows_ - 1, row + 1); ++y) {
        for (int x = std::max(0, column - 1); x <= std::min(columns_ - 1, column + 1); ++x) {
          const int j = y * columns_ + x;
          if (before[j]) sum += table_[j], ++count;
        }
      }
      if (count > 0) table_[i] = sum / static_cast<float>(count), known[i] = 1;
    }
  }
}

Eigen::Vector2d PixelCurvature::along(const Eigen::Vector2d& pixel, const Eigen::Matrix2d& moments) const {
  const double x = std::clamp((pixel.x() + 0.5) / spacing_.x(), 0.0, columns_ - 1.0);
  const double y = std::clamp((pixel.y() + 0.5) / spacing_.y(), 0.0, rows_ - 1.0);
  const int column = std::min(static_cast<int>(x), columns_ - 2),
            row = std::min(static_cast<int>(y), rows_ - 2);
  const auto right = static_cast<float>(x - column), down = static_cast<float>(y - row);
  const Symbols *above = &table_[static_cast<size_t>(row) * columns_ + column], *below = above + columns_;
  const Symbols symbols = (1 - down) * ((1 - right) * above[0] + right * above[1]) +
                          down * ((1 - right) * below[0] + right * below[1]);
  return symbols.cast<double>() * Eigen::Vector3d(moments(0, 0), 2 * moments(0, 1), moments(1, 1));
}

}  // namespace raysfm
