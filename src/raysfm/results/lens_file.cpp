#include "raysfm/results/lens_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"

namespace raysfm {

std::vector<LensOfFrame> lenses_of_frames(const Reconstruction& world) {
  std::vector<LensOfFrame> lenses;
  for (const PosedFrame& frame : world.frames) {
    if (!frame.world_from_rig || frame.lens < 0) continue;
    const FrameLens& from = world.lenses[frame.lens];
    const std::optional<Lens> value = lens_of(from);
    if (!value) continue;
    LensOfFrame& lens = lenses.emplace_back();
    lens.timestamp = frame.timestamp;
    std::ranges::copy(value->vector(), lens.value.begin());
    std::ranges::copy(from.sigma, lens.sigma.begin());
  }
  return lenses;
}

Result<void> write_lens_file(const Reconstruction& world, const std::filesystem::path& path) {
  std::string text = "timestamp,fx,fy,cx,cy,skew,fx_sigma,fy_sigma,cx_sigma,cy_sigma,skew_sigma\n";
  for (const LensOfFrame& lens : lenses_of_frames(world)) {
    text += timestamp_text(lens.timestamp);
    for (const double value : lens.value) text += fmt::format(",{:.6f}", value);
    for (const double sigma : lens.sigma) text += fmt::format(",{:.6g}", sigma);
    text += '\n';
  }
  return write_file(path, text);
}

}  // namespace raysfm
