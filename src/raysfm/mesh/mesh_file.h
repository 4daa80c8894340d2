#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/mesh/surface_mesh.h"

namespace raysfm {

// Writes a mesh as binary little-endian PLY: float x y z, uchar red green blue of its vertices, and faces as
// lists of vertices. `colors`: by vertex. `comment`: a line about the frame.
Result<void> write_mesh_ply(const SurfaceMesh& mesh, const std::vector<std::array<uint8_t, 3>>& colors,
                            const std::string& comment, const std::filesystem::path& path);

}  // namespace raysfm
