#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "raysfm/page/page_mesh.h"
#include "raysfm/results/report_file.h"

namespace raysfm {

// Times of one stage of a run, milliseconds.
struct StageTime {
  std::string name;
  double mean_ms = 0, max_ms = 0;
  int64_t count = 0;
};

// Where a run under way was when its reconstruction was looked at.
struct LiveInfo {
  int frame = -1;  // the newest with a pose; -1: none
  int world = -1;  // of that frame, as a TrackerObserver counts them
};

// The names of inputs or results without their folders.
std::string title_of(const std::vector<std::string>& inputs);

// What a page says beside the reconstruction.
struct PageInfo {
  std::string title = {};  // may hold anything
  std::vector<StageTime> stages = {};
  std::vector<std::string> warnings = {};  // of the run as a whole
  int pictures = 0;                        // cameras whose pictures the server of the page has; 0: of none
  std::optional<LiveInfo> live = {};       // of a run under way
  std::optional<PageMesh> mesh = {};       // the surface of a world
};

// What a report says: named after what was reconstructed.
PageInfo page_info(const Report& report);

// The same of a finished result, named after its folder too. Where its report.json cannot be read, or is an
// older one, some of it is missing.
PageInfo read_page_info(const std::filesystem::path& folder);

}  // namespace raysfm
