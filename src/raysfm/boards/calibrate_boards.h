#pragma once

#include <span>
#include <string>
#include <vector>

#include "raysfm/boards/board_adjustment.h"
#include "raysfm/core/result.h"

namespace raysfm {

// A rig calibrated from a board.
struct BoardCalibration {
  BoardProblem problem;  // with what agrees as its observations; one pose for each view
  BoardSigmas sigmas;
  double rms_px = 0;
  std::vector<double> camera_rms_px, alone_rms_px;  // of each camera in the rig, and calibrated by itself
  std::vector<std::string> left_out;                // one line for each image that does not agree
};

// Cameras, and how they stand to each other, from views of a board. Each camera is calibrated by itself, in
// the model named, or with "auto" in radtan or kannala-brandt, whichever fits better. What they see at the
// same instants then tells where they stand, and all is adjusted together; the first camera is the rig.
// `cameras` have names, sizes and streams. Boards that look alike from two or four sides may be turned
// between the cameras of one view: the turn that agrees with the other views is taken.
// Errors: bad input where the model is unknown, or a camera sees the board in too few views, or never with
// another; no reconstruction where too few images agree, or the views do not tell the focal length.
Result<BoardCalibration> calibrate_boards(const Board& board, std::span<const Camera> cameras,
                                          const std::string& model, std::vector<BoardView> views);

}  // namespace raysfm
