#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/core/timer.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

constexpr uintmax_t kMaxReportBytes = 1u << 30;  // larger ones are not read

// What report.json says beyond the reconstruction itself.
struct Report {
  std::string version;
  uint64_t seed = 0;
  std::vector<std::string> input;  // as the user gave it
  std::string camera_class;        // "central", "axial", "non-axial" or "non-central"
  std::string error;               // "pixel" or "angular"
  bool interrupted = false;        // the input had more
  int frames_in_input = -1;        // -1: unknown
  std::vector<std::string> files;  // of the output folder
  std::vector<std::pair<std::string, StageTiming>> stages;  // in order of appearance, e.g. {"detect", ...}
  double wall_s = 0;
  double frames_per_second = 0;
  double peak_rss_mib = 0;
};

// Text of report.json. Numbers of frames, key frames, points and observations, the segments, the starts and
// the reasons of frames without a pose come from the reconstruction. `start` is that of the first segment,
// `starts` holds those of all segments. `scale` is that of the main world, which `worlds` begins with; the
// others follow in time order.
std::string report_json(const Reconstruction& reconstruction, const Report& report);

// Writes report_json(). Errors: bad input, naming the file.
Result<void> write_report(const Reconstruction& reconstruction, const Report& report,
                          const std::filesystem::path& path);

}  // namespace raysfm
