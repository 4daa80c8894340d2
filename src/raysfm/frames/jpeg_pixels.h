#pragma once

#include <string_view>

#include "raysfm/core/result.h"
#include "raysfm/frames/decoded_image.h"

namespace raysfm {

// Pixels of a JPEG file. Grey is its luma and colours are its chroma, as stored; a file of RGB or CMYK gives
// those, and grey as 0.299 R + 0.587 G + 0.114 B. The size is within kMaxImageSide and kMaxImagePixels.
// Errors: bad input, what is wrong without the name of the file.
Result<DecodedImage> decode_jpeg(std::string_view bytes);

}  // namespace raysfm
