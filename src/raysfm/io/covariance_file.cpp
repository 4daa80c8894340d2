#include "raysfm/io/covariance_file.h"

#include <fmt/format.h>

#include <iterator>
#include <string>

#include "raysfm/io/atomic_file.h"

namespace raysfm {

Result<void> write_covariance_csv(const Reconstruction& world, const std::filesystem::path& path) {
  const char* const names[] = {"vx", "vy", "vz", "wx", "wy", "wz"};
  const char* const unit = world.metric_scale ? "metres" : "arbitrary units of trajectory.txt";
  std::string text = fmt::format(
      "# covariance of world_from_rig in trajectory.txt, points of the map held fixed\n"
      "# tangent (vx, vy, vz, wx, wy, wz), applied on the left, in the axes of the world: R <- exp(w) R, t "
      "<- t + v\n"
      "# upper triangle by rows; v in {}, w in radians\n"
      "timestamp",
      unit);
  for (int i = 0; i < 6; ++i) {
    for (int j = i; j < 6; ++j) text += fmt::format(",{}_{}", names[i], names[j]);
  }
  text += '\n';
  for (const PosedFrame& frame : world.frames) {
    if (!frame.world_from_rig) continue;
    fmt::format_to(std::back_inserter(text), "{:.9f}", frame.timestamp);
    for (int i = 0; i < 6; ++i) {
      for (int j = i; j < 6; ++j) fmt::format_to(std::back_inserter(text), ",{:.9g}", frame.covariance(i, j));
    }
    text += '\n';
  }
  return write_file(path, text);
}

}  // namespace raysfm
