#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/boards/board_adjustment.h"
#include "raysfm/core/result.h"

namespace raysfm {

// Fewest views that differ from one another.
inline constexpr int kMinBoardViews = 3;

// One camera from images of a board, all of them its own (BoardImage::camera is not read): the view of a
// problem is the index of the image. Focal lengths are tried one after the other, the board is posed by each
// (robust/absolute_pose.h), and the best are adjusted under a robust loss. Then corners and images that do
// not agree are left out, and least squares of the rest are what is found. `camera` has the size of the
// images; `left_out` takes one line for each image that is left out. Errors: bad input where the model is
// unknown; no reconstruction where fewer than kMinBoardViews images agree with any camera.
Result<BoardProblem> calibrate_camera(const Board& board, const Camera& camera, std::string_view model,
                                      std::span<const BoardImage> images, std::vector<std::string>* left_out);

// Puts the corners of `images` that agree with the cameras and poses of the problem into it as its
// observations, and images of which too many do not, left_out, not. images[v] are those of view v.
void keep_agreeing(std::span<const BoardView> views, BoardProblem* problem,
                   std::vector<std::string>* left_out);

// Root mean square of the residuals of all observations, or of those of one camera; pixels.
double rms_of(const BoardProblem& problem, int camera = -1);

}  // namespace raysfm
