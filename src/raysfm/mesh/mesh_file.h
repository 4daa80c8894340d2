#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/mesh/mesh_texture.h"
#include "raysfm/mesh/surface_mesh.h"

namespace raysfm {

// Writes a mesh as binary little-endian PLY: float x y z, uchar red green blue of its vertices, and faces as
// lists of vertices. `colors`: by vertex. `comment`: a line about the frame.
Result<void> write_mesh_ply(const SurfaceMesh& mesh, const std::vector<std::array<uint8_t, 3>>& colors,
                            const std::string& comment, const std::filesystem::path& path);

// Writes NAME.obj, NAME.mtl and NAME.jpg into `folder`: positions, places in the texture from its lower left
// corner, faces of both; one material that is as bright as its texture, without light. Errors: bad input,
// where a file cannot be written; internal where memory is not enough.
Result<void> write_mesh_obj(const SurfaceMesh& mesh, const MeshTexture& texture, const std::string& comment,
                            const std::filesystem::path& folder, const std::string& name);

}  // namespace raysfm
