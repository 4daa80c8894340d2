#pragma once

#include "raysfm/api/solve_input.h"
#include "raysfm/frames/frame_source.h"

namespace raysfm {

// The camera of settings.camera, fit for the images of `opened`, or of any size where that is null. Errors:
// bad input, also of what is no single camera with one viewpoint that sees all of an image: of that, only
// videos are understood.
Result<Camera> known_camera(const SolveSettings& settings, const Input* opened, const EventSink& event);

// Poses and map of the images of input.camera, adjusted together. Errors: no reconstruction, with the reason.
Result<SolveResult> solve_with_camera(const SolveInput& input, const SolveSettings& settings,
                                      const SolveCallbacks& callbacks);

}  // namespace raysfm
