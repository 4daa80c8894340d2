#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/frames/decoded_image.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Whether the file begins like an image: PNG, JPEG, BMP, TIFF, PNM or WebP. The name does not matter.
bool is_image_file(const std::filesystem::path& path);

// Decodes an image file of 8 or 16 bits; 16 bits are scaled so that 65535 becomes 255. Grey is the luma of a
// JPEG as stored, else 0.299 R + 0.587 G + 0.114 B. Transparency is dropped, an orientation in the file is
// ignored: calibrations are of the pixels as stored. Errors, naming the file: bad input; internal where
// memory is short.
Result<DecodedImage> read_image(const std::filesystem::path& path);

// The mask of a camera, 255 where a pixel sees the scene, else 0 (values above 127 count as 255). Errors: bad
// input, also when it has not the given size.
Result<GrayImage> read_mask(const std::filesystem::path& path, int width, int height);

}  // namespace raysfm
