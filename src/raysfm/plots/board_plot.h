#pragma once

#include <filesystem>

#include "raysfm/boards/calibrate_boards.h"
#include "raysfm/core/result.h"

namespace raysfm {

// Draws a PNG: for each camera of a calibration from a board where its corners were seen, and how far each is
// from where the camera found sees it, enlarged. At most 16 cameras.
Result<void> plot_boards(const BoardCalibration& calibration, const std::filesystem::path& path);

}  // namespace raysfm
