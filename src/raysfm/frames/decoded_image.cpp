#include "raysfm/frames/decoded_image.h"

#include <fmt/format.h>

namespace raysfm {

Result<void> check_image_size(int64_t width, int64_t height) {
  if (width > 0 && height > 0 && width <= kMaxImageSide && height <= kMaxImageSide &&
      width * height <= kMaxImagePixels) {
    return {};
  }
  return bad_input(
      fmt::format("{} x {} pixels; allowed: sides from 1 to {}, 2^29 pixels", width, height, kMaxImageSide));
}

}  // namespace raysfm
