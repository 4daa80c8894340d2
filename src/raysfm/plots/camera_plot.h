#pragma once

#include <filesystem>

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"

namespace raysfm {

// Draws a PNG with one row for each camera that says its size:
//   the angle of each pixel's ray from the z axis, curves every 10 degrees, arrows where the rays point to;
//   pixels per degree over the image;
//   the field of view as the camera sees it, azimuth and angle from the axis, with lines of the image.
// Pixels without a ray stay grey. A rig of several cameras gets a last row: their places from above and from
// the side, each with the middle and the edges of what it sees. Errors: bad input where no camera has a size;
// those of writing the file.
Result<void> plot_cameras(const Rig& rig, const std::filesystem::path& path);

}  // namespace raysfm
