#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "raysfm/boards/calibrate_boards.h"

namespace raysfm {

// Cells of an image, of equal size, row by row.
inline constexpr int kCoverageCells = 5;
using ImageCells = std::array<uint8_t, kCoverageCells * kCoverageCells>;

// The cell of a pixel of a camera's image.
int cell_of(const Camera& camera, const Eigen::Vector2d& pixel);

// What to film more, one sentence each, none where nothing is missing: parts of the image without a corner of
// the board, too few views, a board that is never tilted or always small, a focal length that is told
// poorly, errors that say that the model does not fit or that cameras were not in step. lit[c]: cells of
// camera c in which the images ever show anything; a fisheye's corners are black.
std::vector<std::string> board_advice(const BoardCalibration& calibration, std::span<const ImageCells> lit);

}  // namespace raysfm
