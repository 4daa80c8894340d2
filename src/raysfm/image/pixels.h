#pragma once

#include <cstddef>
#include <cstdint>

#include "raysfm/image/color_planes.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Bytes of a pixel, in the order of memory.
enum class PixelFormat : uint8_t { kGray, kRgb, kBgr, kRgba, kBgra };

// An image in the memory of whoever has a camera. Row r starts at data + r * stride (bytes; may be negative,
// for images that are stored bottom up).
struct PixelView {
  const uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  ptrdiff_t stride = 0;
  PixelFormat format = PixelFormat::kGray;

  bool empty() const { return data == nullptr || width <= 0 || height <= 0; }
};

// Copies a view that is not empty: its grey levels, those of gray_of() where it has colours, and these.
void copy_pixels(const PixelView& pixels, GrayImage* gray, ColorPlanes* colors);

}  // namespace raysfm
