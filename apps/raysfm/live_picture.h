#pragma once

#include <string>

#include "raysfm/core/result.h"
#include "raysfm/odometry/odometry.h"

namespace raysfm::app {

// JPEG of what a camera of a view showed, grey, in the finest of its octaves that is at most 640 pixels a
// side, else the coarsest. Errors: bad input, where there is no such camera.
Result<std::string> picture_of(const View& view, int camera);

// What is to be drawn over it, in pixels of the image as taken: as page/frame_features.h has it, with a
// `note`.
std::string features_of(const NewestView& newest, int camera);

}  // namespace raysfm::app
