#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/solving/solve_input.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// How images in no order are reconstructed along rays. `callbacks` must outlive it.
RayOptions ray_options(const SolveInput& input, const SolveSettings& settings,
                       const SolveCallbacks& callbacks);

// Worlds of images without a pose (`posed`: one mark per image) that see enough of one another, the largest
// first, through the camera that took all of them, which stays as it is. What less than 0.85 of the
// observations agree with is none.
std::vector<RayReconstruction> worlds_left_out(const SolveInput& input, std::span<const uint8_t> posed,
                                               const Camera& camera, const SolveSettings& settings,
                                               const SolveCallbacks& callbacks);

// The same of what a reconstruction of one lens leaves out of photos, or of tracks in no order; none of
// others.
std::vector<RayReconstruction> worlds_left_out(const SolveInput& input,
                                               const UncalibratedReconstruction& found,
                                               const SolveSettings& settings,
                                               const SolveCallbacks& callbacks);

}  // namespace raysfm
