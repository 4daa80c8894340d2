#pragma once

#include <filesystem>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Writes the points of the map as binary little-endian PLY: float x y z, uchar red green blue.
Result<void> write_points_ply(const Reconstruction& world, const std::filesystem::path& path);

// Position and colour of the points of such a file. Errors: bad input, naming the file.
Result<std::vector<MapPoint>> read_points_ply(const std::filesystem::path& path);

}  // namespace raysfm
