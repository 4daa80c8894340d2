#pragma once

#include <optional>

#include "raysfm/api/solve.h"
#include "raysfm/api/solve_input.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// The tracks of a video whose stretches were joined, and what was found of it before, by their points.
struct JoinedStretches {
  SolveInput input;
  std::optional<UncalibratedReconstruction> start;
};

// Where a reconstruction leaves key frames of a video out, or there is none (null): its tracks, with the
// points made one that descriptors say are the same though no track does. None where there are none.
std::optional<JoinedStretches> joined_stretches(const SolveInput& input,
                                                const UncalibratedReconstruction* found,
                                                const SolveSettings& settings,
                                                const SolveCallbacks& callbacks);

// The whole video, tracked with the one lens that was found: it loses the track and finds it again, and
// begins further worlds where nothing is known. None where lenses zoom, or where that does not pose more
// frames by a tenth. Errors: as track().
Result<std::optional<SolveResult>> tracked_with_lens(const SolveInput& input,
                                                     const UncalibratedReconstruction& found,
                                                     const SolveSettings& settings,
                                                     const SolveCallbacks& callbacks);

}  // namespace raysfm
