#pragma once

#include "raysfm/api/solve.h"
#include "raysfm/api/solve_input.h"

namespace raysfm {

// Joins the points of stretches of a video that show the same places, and tells of it. Without stretches
// everything stays as it is, bit by bit.
void join_stretches(const SolveSettings& settings, const SolveCallbacks& callbacks, SolveInput* input);

}  // namespace raysfm
