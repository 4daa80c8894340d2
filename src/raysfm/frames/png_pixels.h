#pragma once

#include <string_view>

#include "raysfm/core/result.h"
#include "raysfm/frames/decoded_image.h"

namespace raysfm {

// Whether decode_png() knows this PNG file: 8 or 16 bits, no palette, not interlaced.
bool is_plain_png(std::string_view bytes);

// Pixels of a plain PNG file whose chunks pixel_chunks_of_png() has checked; 65535 of 16 bits becomes 255,
// alpha is left out of grey. Errors: bad input, what is wrong without the name of the file.
Result<DecodedImage> decode_png(std::string_view bytes);

}  // namespace raysfm
