#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/image/image.h"

namespace raysfm {

// The inner corners of a chessboard, columns times rows of them, row by row, to a fraction of a pixel; none
// where the image does not show the whole board. Rows and columns turn as the axes of an image do, whichever
// way the board is held; where one number is odd and the other even, the first square between corners is the
// dark one, so that all images mean the same first corner. Errors: internal.
Result<std::vector<Eigen::Vector2d>> find_board_corners(const GrayView& image, int columns, int rows);

// Inner corners of the largest chessboard that an image seems to show, the larger number first; zeros where
// there is none. For telling what may be meant by a wrong size. Errors: internal.
Result<std::array<int, 2>> guess_board_size(const GrayView& image);

}  // namespace raysfm
