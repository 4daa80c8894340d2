#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Writes `timestamp` and the 21 entries of the upper triangle, by rows, of the covariance of each frame that
// has a pose. Tangent (v, w) as in docs/conventions.md; the header of the file repeats order, side and units.
Result<void> write_covariance_csv(const Reconstruction& world, const std::filesystem::path& path);

}  // namespace raysfm
