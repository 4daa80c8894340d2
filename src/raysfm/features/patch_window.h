#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>

#include <Eigen/Core>

#include "raysfm/image/image.h"

namespace raysfm {

// Rows of a patch of which kBlockWidth bytes each may be read, although the patch is narrower.
struct PixelBlock {
  const uint8_t* data = nullptr;
  ptrdiff_t stride = 0;
};
constexpr int kBlockWidth = 32;
template <int kRows>
using BlockBuffer = std::array<uint8_t, kRows * kBlockWidth>;

// The block of `columns` x kRows pixels whose top-left pixel is (x, y); it lies inside the image. Copied to
// `buffer` where it is so near to the right border that vector loads would pass the end of the image.
template <int kRows>
PixelBlock readable_block(const GrayView& image, int x, int y, int columns, BlockBuffer<kRows>* buffer) {
  if (x + kBlockWidth <= image.width) return {image.row(y) + x, image.stride};
  for (int r = 0; r < kRows; ++r)
    std::copy_n(image.row(y + r) + x, columns, buffer->data() + r * kBlockWidth);
  return {buffer->data(), kBlockWidth};
}

// The map from offsets in a patch to pixels of an image, (x, y) + m o, in fixed point.
constexpr int kFixedBits = 16;
struct AffineWindow {
  int32_t x, y;
  int32_t m00, m01, m10, m11;
};

// None where the window, offsets up to `radius` in both directions, comes within a pixel of the border (three
// at the right one), or where a number is not finite.
inline std::optional<AffineWindow> affine_window(const GrayView& image, const Eigen::Vector2f& pixel,
                                                 const Eigen::Matrix2f& m, int radius) {
  constexpr int kMaxSide = 1 << (31 - kFixedBits);
  const Eigen::Vector2f reach = static_cast<float>(radius) * m.cwiseAbs().rowwise().sum();
  const bool inside = pixel.x() - reach.x() >= 1 && pixel.y() - reach.y() >= 1 &&
                      pixel.x() + reach.x() < static_cast<float>(image.width - 4) &&
                      pixel.y() + reach.y() < static_cast<float>(image.height - 2);
  if (!inside || image.width > kMaxSide || image.height > kMaxSide) return std::nullopt;
  const auto fixed = [](float v) { return static_cast<int32_t>(std::lround(v * (1 << kFixedBits))); };
  return AffineWindow{fixed(pixel.x()), fixed(pixel.y()), fixed(m(0, 0)),
                      fixed(m(0, 1)),   fixed(m(1, 0)),   fixed(m(1, 1))};
}

}  // namespace raysfm
