#pragma once

#include <string>

#include "raysfm/core/result.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Bytes of a JPEG file. `rgb`: red, green, blue interleaved, width 3 * pixels per row; `quality` 1 to 100.
// Errors: bad input for an empty image or one of more than 65500 pixels a side; internal where memory is not
// enough.
Result<std::string> encode_jpeg(ImageView<const uint8_t> rgb, int quality);

}  // namespace raysfm
