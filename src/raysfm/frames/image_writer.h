#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Write a PNG of 8 bits per channel beside its final name, then rename it. Errors: no such folder, no
// permission, disk full; an empty image is bad input.
Result<void> write_png(const std::filesystem::path& path, GrayView gray);

// `bgr`: blue, green, red interleaved, width 3 * pixels per row.
Result<void> write_color_png(const std::filesystem::path& path, ImageView<const uint8_t> bgr);

}  // namespace raysfm
