#pragma once

#include <optional>

#include "raysfm/api/solve.h"
#include "raysfm/api/track.h"

namespace raysfm {

// A video of a camera that zooms, tracked with the zoom undone (unzoomed()) by focal lengths that are known
// roughly: its map tells each key frame's focal length anew, and so on until these settle. None where they do
// not. Each frame with a pose has a lens of its own (Origin::kSolve).

// From a solution with a lens for each image, and with its report of the lens. None either where that places
// fewer frames than the solution.
std::optional<SolveResult> tracked_through_zoom(const SolveResult& solved, const SolveSettings& settings,
                                                const SolveCallbacks& callbacks);

// From what a map that was tracked with one lens, and no known zoom, says of its key frames.
std::optional<TrackResult> tracked_through_zoom(const TrackResult& tracked, const TrackSettings& settings,
                                                const TrackCallbacks& callbacks);

}  // namespace raysfm
