#pragma once

#include <span>
#include <vector>

#include "raysfm/boards/board_adjustment.h"
#include "raysfm/core/result.h"

namespace raysfm {

// Cameras that were calibrated one by one put together to a rig. alone[c] is camera c with one pose for each
// view of `views`, of which those where it has observations count. Corners of boards that look alike when
// turned are turned in `views` so that all cameras of a view mean the same ones. No observations are set.
// Errors: bad input where a camera never sees the board together with those before.
Result<BoardProblem> start_rig(std::span<const BoardProblem> alone, std::vector<BoardView>* views);

}  // namespace raysfm
