#include "raysfm/io/ply_file.h"

#include <fmt/format.h>

#include <string>

#include "raysfm/io/atomic_file.h"
#include "raysfm/io/little_endian.h"

namespace raysfm {

Result<void> write_points_ply(const Reconstruction& world, const std::filesystem::path& path) {
  std::string bytes = fmt::format(
      "ply\n"
      "format binary_little_endian 1.0\n"
      "comment map points in the world frame of trajectory.txt: x right, y down, z forward at its start\n"
      "comment scale: {}\n",
      world.metric_scale ? "metric, metres" : "arbitrary");
  bytes += fmt::format(
      "element vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "end_header\n",
      world.points.size());
  bytes.reserve(bytes.size() + 15 * world.points.size());
  for (const MapPoint& point : world.points) {
    for (int i = 0; i < 3; ++i) append_little_endian(bytes, static_cast<float>(point.position[i]));
    for (const uint8_t channel : point.rgb) append_little_endian(bytes, channel);
  }
  return write_file(path, bytes);
}

}  // namespace raysfm
