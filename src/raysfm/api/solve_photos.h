#pragma once

#include "raysfm/api/solve_input.h"

namespace raysfm {

// Most photos among which every one is compared with every other.
inline constexpr int kMaxPhotos = 40;

// Whether some image shares too few tracks with the one before for a video.
bool looks_like_photos(const SolveInput& video);

// Tracks of photos that may be taken from anywhere: matches of all pairs that agree with a fundamental
// matrix. Errors: bad input.
Result<SolveInput> tracks_from_photos(const SolveSettings& settings, const SolveCallbacks& callbacks);

}  // namespace raysfm
