#include "build_facts.h"

#include <fmt/format.h>
#include <hwy/highway.h>
#include <hwy/targets.h>

#include "raysfm/page/page.h"

namespace raysfm::app {

std::string build_facts() {
  std::string compiled;
  const int64_t targets = HWY_TARGETS;
  for (int64_t bit = int64_t{1} << 62; bit > 0; bit >>= 1) {
    if (targets & bit) compiled += fmt::format("{}{}", compiled.empty() ? "" : ", ", hwy::TargetName(bit));
  }
  const int64_t usable = targets & hwy::SupportedTargets();
  return fmt::format(
      "{}\ncompiler: {}, {}\nSIMD: {} on this machine, of {}\nparts: OpenCV {} and FFmpeg (libavcodec {}), "
      "loaded when they "
      "are needed; page of results {}",
      RAYSFM_VERSION, RAYSFM_COMPILER, RAYSFM_BUILD_TYPE, hwy::TargetName(usable & -usable), compiled,
      RAYSFM_OPENCV_VERSION, RAYSFM_AVCODEC_VERSION, has_page() ? "included" : "left out");
}

}  // namespace raysfm::app
