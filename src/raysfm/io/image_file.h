#pragma once

#include <filesystem>
#include <optional>

#include "raysfm/core/result.h"
#include "raysfm/image/color_planes.h"
#include "raysfm/image/image.h"

namespace raysfm {

struct DecodedImage {
  GrayImage gray;
  ColorPlanes colors;
};

// Whether the file begins like an image: PNG, JPEG, BMP, TIFF, PNM or WebP. The name does not matter.
bool is_image_file(const std::filesystem::path& path);

// Decodes an image file of 8 or 16 bits; 16 bits are scaled so that 65535 becomes 255. Grey is 0.299 R +
// 0.587 G + 0.114 B. Transparency is dropped, an orientation in the file is ignored: calibrations are of the
// pixels as stored. Errors: bad input, naming the file.
Result<DecodedImage> read_image(const std::filesystem::path& path);

// The mask of a camera, 255 where a pixel sees the scene, else 0 (values above 127 count as 255). Errors: bad
// input, also when it has not the given size.
Result<GrayImage> read_mask(const std::filesystem::path& path, int width, int height);

}  // namespace raysfm
