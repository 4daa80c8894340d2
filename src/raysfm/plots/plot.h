#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/eval/trajectory_error.h"
#include "raysfm/geometry/trajectory.h"

namespace raysfm {

// Draws a PNG: truth and aligned estimate seen from above (the plane of the two largest principal components
// of the truth), and below it the position error over time.
Result<void> plot_evaluation(const Trajectory& estimate, const Trajectory& truth,
                             const Evaluation& evaluation, const std::filesystem::path& path);

}  // namespace raysfm
