#pragma once

#include <string>

#include "raysfm/core/result.h"
#include "raysfm/frames/decoded_image.h"

namespace raysfm {

// Pixels of an image file of any format that OpenCV decodes. Errors: bad input, what is wrong without the
// name of the file.
Result<DecodedImage> decode_other(const std::string& bytes);

// OpenCV's own lines on stderr, in the whole process.
void silence_opencv();

}  // namespace raysfm
