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

// Those of a report, in its order.
std::vector<StageTime> stage_times(const Report& report);

// The same of the report.json of a finished result; none where that cannot be read, or is an older one.
std::vector<StageTime> read_stage_times(const std::filesystem::path& folder);

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
  int pictures = 0;                   // cameras whose pictures the server of the page has; 0: of none
  std::optional<LiveInfo> live = {};  // of a run under way
  std::optional<PageMesh> mesh = {};  // the surface of a world
};

}  // namespace raysfm
