#include "raysfm/mesh/mesh_file.h"

#include <fmt/format.h>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/little_endian.h"

namespace raysfm {

Result<void> write_mesh_ply(const SurfaceMesh& mesh, const std::vector<std::array<uint8_t, 3>>& colors,
                            const std::string& comment, const std::filesystem::path& path) {
  std::string bytes = fmt::format(
      "ply\n"
      "format binary_little_endian 1.0\n"
      "comment {}\n"
      "element vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "element face {}\n"
      "property list uchar int vertex_indices\n"
      "end_header\n",
      comment, mesh.positions.size(), mesh.faces.size());
  bytes.reserve(bytes.size() + 15 * mesh.positions.size() + 13 * mesh.faces.size());
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    for (const double x : mesh.positions[v]) append_little_endian(bytes, static_cast<float>(x));
    for (const uint8_t channel : colors[v]) append_little_endian(bytes, channel);
  }
  for (const std::array<int, 3>& face : mesh.faces) {
    append_little_endian(bytes, uint8_t{3});
    for (const int v : face) append_little_endian(bytes, static_cast<int32_t>(v));
  }
  return write_file(path, bytes);
}

}  // namespace raysfm
