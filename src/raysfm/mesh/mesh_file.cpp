#include "raysfm/mesh/mesh_file.h"

#include <fmt/format.h>

#include <iterator>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/little_endian.h"
#include "raysfm/frames/jpeg_writer.h"

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

Result<void> write_mesh_obj(const SurfaceMesh& mesh, const MeshTexture& texture, const std::string& comment,
                            const std::filesystem::path& folder, const std::string& name) {
  constexpr int kQuality = 92;
  const Result<std::string> jpeg = encode_jpeg(texture.rgb, kQuality);
  if (!jpeg) return jpeg.error();
  if (auto written = write_file(folder / (name + ".jpg"), *jpeg); !written) return written;
  const std::string material = fmt::format(
      "newmtl texture\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Ka {0}.jpg\nmap_Kd {0}.jpg\n", name);
  if (auto written = write_file(folder / (name + ".mtl"), material); !written) return written;
  std::string text = fmt::format("# {}\nmtllib {}.mtl\n", comment, name);
  const auto out = std::back_inserter(text);
  for (const Eigen::Vector3d& x : mesh.positions)
    fmt::format_to(out, "v {:.7g} {:.7g} {:.7g}\n", x.x(), x.y(), x.z());
  const double width = texture.rgb.width() / 3.0, height = texture.rgb.height();
  for (const auto& corners : texture.places) {
    for (const Eigen::Vector2d& at : corners)
      fmt::format_to(out, "vt {:.6f} {:.6f}\n", (at.x() + 0.5) / width, 1 - (at.y() + 0.5) / height);
  }
  text += "usemtl texture\n";
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const auto& [a, b, c] = mesh.faces[f];
    fmt::format_to(out, "f {}/{} {}/{} {}/{}\n", a + 1, 3 * f + 1, b + 1, 3 * f + 2, c + 1, 3 * f + 3);
  }
  return write_file(folder / (name + ".obj"), text);
}

}  // namespace raysfm
