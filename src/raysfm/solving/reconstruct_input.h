#pragma once

#include <atomic>

#include "raysfm/solving/solve_input.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// Of the images, with a pose: a good reconstruction.
inline constexpr double kGoodShare = 0.8;

// What the settings say of a reconstruction; it ends early where *stop becomes true (null: never).
SolveOptions solve_options(const SolveSettings& settings, const std::atomic<bool>* stop);

// Structure, motion and lenses of the tracks, with the focal length that all photos are said to have, if it
// holds: else input->exif says why it does not. `start`: a reconstruction of a part to go on from, as in
// VideoOptions. Errors: as reconstruct_video().
Result<UncalibratedReconstruction> reconstruct_input(SolveInput* input, const SolveSettings& settings,
                                                     const SolveCallbacks& callbacks,
                                                     const UncalibratedReconstruction* start = nullptr);

// The share of the images that have a pose; 0 without a reconstruction.
double reached_share(const Result<UncalibratedReconstruction>& found);

}  // namespace raysfm
