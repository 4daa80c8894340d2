#pragma once

#include <optional>

#include "raysfm/api/solve.h"
#include "raysfm/api/track.h"
#include "raysfm/solving/solve_input.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// How the tracker goes through what solve() was given: with the lens as it is, and no rolling shutter.
TrackSettings settings_of_tracking(const SolveSettings& settings);

// What a solution was before it was tracked, in the report of that: its lens, adjustment and stages.
void go_on_from(const Report& solved, Report* tracked);

// The whole video, tracked with the one lens that was found: it loses the track and finds it again, and
// begins further worlds where nothing is known. None where lenses zoom, or where that does not pose more
// frames by a tenth. Errors: as track().
Result<std::optional<SolveResult>> tracked_with_lens(const SolveInput& input,
                                                     const UncalibratedReconstruction& found,
                                                     const SolveSettings& settings,
                                                     const SolveCallbacks& callbacks);

}  // namespace raysfm
