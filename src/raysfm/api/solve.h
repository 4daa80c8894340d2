#pragma once

#include <filesystem>
#include <string>

#include "raysfm/core/result.h"
#include "raysfm/results/report_file.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/solving/solve_settings.h"

namespace raysfm {

// What `solve` gives: structure, motion and lenses (Origin::kSolve), or the camera that was given
// (Origin::kTrack). A world is the camera of its first frame with a pose, its scale arbitrary, unless it is
// given by known structure: `metric_scale` then means its unit. Photos that fall apart are several worlds.
struct SolveResult {
  Reconstruction reconstruction;
  Report report;  // with `lens` and `adjustment`, where no camera was given
};

// Unknown or zooming lens (IFBA01), or photos of a known camera. Errors: bad input; no reconstruction with
// the reason.
Result<SolveResult> solve(const SolveSettings& settings, const SolveCallbacks& callbacks);

// Whether writing the results into `folder` would leave the input alone; else bad input.
Result<void> check_solve_output(const std::filesystem::path& input, const std::filesystem::path& folder);

// Writes the results into the folder: write_output_folder() with config.yaml and lens.png.
Result<void> write_solve_output(const SolveResult& result, const SolveSettings& settings,
                                const std::string& version, const std::filesystem::path& folder);

}  // namespace raysfm
