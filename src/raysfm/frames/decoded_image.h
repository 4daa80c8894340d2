#pragma once

#include <cstdint>

#include "raysfm/core/result.h"
#include "raysfm/image/color_planes.h"
#include "raysfm/image/image.h"

namespace raysfm {

// What a decoder gives: grey levels, and colours where there are any.
struct DecodedImage {
  GrayImage gray;
  ColorPlanes colors;
};

// Larger images are refused, pixels.
inline constexpr int64_t kMaxImageSide = 32768;
inline constexpr int64_t kMaxImagePixels = int64_t{1} << 29;

// What every decoder asks before it makes room for pixels. Errors: bad input, without the name of the file.
Result<void> check_image_size(int64_t width, int64_t height);

}  // namespace raysfm
