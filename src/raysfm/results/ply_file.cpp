#include "raysfm/results/ply_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <string_view>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/little_endian.h"
#include "raysfm/files/text_file.h"

namespace raysfm {
namespace {

constexpr uintmax_t kMaxPlyBytes = 1u << 30;
constexpr size_t kVertexBytes = 15;

}  // namespace

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

Result<std::vector<MapPoint>> read_points_ply(const std::filesystem::path& path) {
  const Result<std::string> text = read_text_file(path, kMaxPlyBytes);
  if (!text) return text.error();
  const std::string_view bytes = *text, element = "element vertex ", end = "end_header\n";
  const size_t vertices = bytes.find(element), header = bytes.find(end);
  std::vector<MapPoint> points;
  if (vertices < header && header != bytes.npos) {
    const std::string_view count = bytes.substr(vertices + element.size());
    points.resize(
        std::min<size_t>(bytes.size(), parse_integer(count.substr(0, count.find('\n'))).value_or(0)));
  }
  if (header == bytes.npos || bytes.size() - header - end.size() != kVertexBytes * points.size()) {
    return bad_input(fmt::format("{}: not a file of points as `track` writes them", path.string()));
  }
  const char* next = bytes.data() + header + end.size();
  for (MapPoint& point : points) {
    float position[3];
    std::memcpy(position, next, sizeof(position));
    std::memcpy(point.rgb.data(), next + sizeof(position), point.rgb.size());
    point.position = {position[0], position[1], position[2]};
    next += kVertexBytes;
  }
  return points;
}

}  // namespace raysfm
