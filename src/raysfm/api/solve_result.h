#pragma once

#include "raysfm/api/solve.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/solving/solve_input.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// What was found, as a reconstruction and a report; times are left to the caller. Poses are told from the
// camera of the first image with a pose, unless the world is given. `interrupted`: the input had more.
SolveResult solve_result(const SolveInput& input, UncalibratedReconstruction found,
                         const SolveSettings& settings, bool interrupted);

// The same of images of a known camera, some of which have a pose.
SolveResult solve_result(const SolveInput& input, const RayReconstruction& found,
                         const SolveSettings& settings, bool interrupted);

// The chart of the lenses of its frames, for the folder of results; empty where these have none of their own.
std::vector<ResultFile> lens_plot(const Reconstruction& reconstruction);

}  // namespace raysfm
