#include "raysfm/image/pixels.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

namespace raysfm {
namespace {

using Rgb = std::array<uint8_t, 3>;

constexpr int kPixelsWidth = 5, kPixelsHeight = 3, kPadding = 7;

Rgb color(int x, int y) {
  return {static_cast<uint8_t>(50 * x), static_cast<uint8_t>(80 * y), static_cast<uint8_t>(200 - 30 * x)};
}

// Rows of a picture in the given order of red, green, blue, followed by bytes that belong to nobody.
std::vector<uint8_t> memory(const std::array<int, 3>& order, int bytes) {
  std::vector<uint8_t> out((kPixelsWidth * bytes + kPadding) * kPixelsHeight, 77);
  for (int y = 0; y < kPixelsHeight; ++y) {
    for (int x = 0; x < kPixelsWidth; ++x) {
      for (int c = 0; c < 3; ++c) {
        out[y * (kPixelsWidth * bytes + kPadding) + x * bytes + order[c]] = color(x, y)[c];
      }
    }
  }
  return out;
}

void expect_picture(const PixelView& view) {
  GrayImage gray;
  ColorPlanes colors;
  copy_pixels(view, &gray, &colors);
  ASSERT_EQ(gray.width(), kPixelsWidth);
  ASSERT_EQ(gray.height(), kPixelsHeight);
  for (int y = 0; y < kPixelsHeight; ++y) {
    for (int x = 0; x < kPixelsWidth; ++x) {
      const Rgb c = color(x, y);
      EXPECT_EQ(colors.at(x, y, 0), c) << x << ", " << y;
      EXPECT_NEAR(gray.row(y)[x], 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2], 0.51) << x << ", " << y;
    }
  }
}

TEST(Pixels, AllOrdersOfBytesGiveTheSamePicture) {
  const struct {
    PixelFormat format;
    std::array<int, 3> order;
    int bytes;
  } kinds[] = {{PixelFormat::kRgb, {0, 1, 2}, 3},
               {PixelFormat::kBgr, {2, 1, 0}, 3},
               {PixelFormat::kRgba, {0, 1, 2}, 4},
               {PixelFormat::kBgra, {2, 1, 0}, 4}};
  for (const auto& kind : kinds) {
    const std::vector<uint8_t> bytes = memory(kind.order, kind.bytes);
    expect_picture(
        {bytes.data(), kPixelsWidth, kPixelsHeight, kPixelsWidth * kind.bytes + kPadding, kind.format});
  }
}

TEST(Pixels, RowsMayBeStoredBottomUp) {
  std::vector<uint8_t> levels(kPixelsWidth * kPixelsHeight);
  for (size_t i = 0; i < levels.size(); ++i) levels[i] = static_cast<uint8_t>(i);
  GrayImage gray;
  ColorPlanes colors;
  copy_pixels(
      {levels.data() + kPixelsWidth * (kPixelsHeight - 1), kPixelsWidth, kPixelsHeight, -kPixelsWidth}, &gray,
      &colors);
  EXPECT_TRUE(colors.empty());
  for (int y = 0; y < kPixelsHeight; ++y) {
    for (int x = 0; x < kPixelsWidth; ++x)
      EXPECT_EQ(gray.row(y)[x], kPixelsWidth * (kPixelsHeight - 1 - y) + x);
  }
}

}  // namespace
}  // namespace raysfm
