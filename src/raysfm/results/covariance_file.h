#pragma once

#include <filesystem>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Writes `timestamp` and the 21 entries of the upper triangle, by rows, of the covariance of each frame that
// has a pose. Tangent (v, w) as in docs/conventions.md; the header of the file repeats order, side and units.
Result<void> write_covariance_csv(const Reconstruction& world, const std::filesystem::path& path);

// The covariances in the order of the file. Errors: bad input, naming file and line.
Result<std::vector<Matrix6d>> read_covariance_csv(const std::filesystem::path& path);

}  // namespace raysfm
