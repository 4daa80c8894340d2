#pragma once

#include <span>

#include "raysfm/api/solve.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/solving/solve_input.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// What was found, as a reconstruction and a report; times are left to the caller. Poses are told from the
// camera of the first image with a pose, unless the world is given. `others`: worlds of images that `found`
// leaves out, taken with its one lens. `interrupted`: the input had more.
SolveResult solve_result(const SolveInput& input, UncalibratedReconstruction found,
                         std::span<const RayReconstruction> others, const SolveSettings& settings,
                         bool interrupted);

// The same of images of a known camera: one world or more, the largest first.
SolveResult solve_result(const SolveInput& input, std::span<const RayReconstruction> worlds,
                         const SolveSettings& settings, bool interrupted);

// The chart of the lenses of its frames, for the folder of results; empty where these have none of their own.
std::vector<ResultFile> lens_plot(const Reconstruction& reconstruction);

}  // namespace raysfm
