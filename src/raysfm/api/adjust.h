#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include "raysfm/api/config.h"
#include "raysfm/bundle/bundle_methods.h"
#include "raysfm/colmap_bal/bal_file.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/core/callbacks.h"
#include "raysfm/core/result.h"

namespace raysfm {

// What `raysfm adjust` is told. Field names are those of the command line and of --config.
struct AdjustSettings {
  std::string input;              // BAL file, plain or bzip2, or folder of a COLMAP model
  std::string method = "global";  // "global", "local" or "hierarchical"
  std::string loss = "none";      // "none", "huber", "cauchy" or "tukey"
  double loss_scale = 1;          // pixels, where the loss leaves the parabola
  int max_iterations = 50;        // of every single adjustment
  int threads = 0;                // 0: as many as the machine has; never changes a result
  uint64_t seed = 0;              // for the report: nothing here is random
};

// All settings but the input. The fields point into `settings`.
std::vector<SettingField> setting_fields(AdjustSettings& settings);

// What a caller hears while the adjustment runs, which ends after the iteration that is running when it is to
// stop.
using AdjustCallbacks = Callbacks<const IterationInfo&>;

struct AdjustCounts {
  int images = 0;  // with a pose; in a BAL file its cameras
  int cameras = 0;
  int points = 0;
  int observations = 0;
  int images_left_out = 0;  // without an observation that takes part
  int points_left_out = 0;  // seen by fewer than two images
};

struct AdjustResult {
  std::variant<BalFile, ColmapModel> model;  // adjusted; what is left out is as it was
  AdjustCounts counts;
  BundleSummary summary;
  double initial_rms_px = 0, final_rms_px = 0;  // over the observations that take part and project
  double read_s = 0, wall_s = 0, peak_rss_mib = 0;
  bool kept_start = false;  // the adjustment would have raised the cost, so the model is as it was
  bool interrupted = false;
};

// Bundle adjustment of a file. A BAL camera's f, k1 and k2 are refined with its pose; the intrinsics of a
// COLMAP model stay as they are. Points seen by fewer than two images, and images that see none of the
// others, are left out: they keep their places and are counted. For the local and the hierarchical method the
// sequence is that of the cameras in a BAL file and of the images' names in a COLMAP model.
//
// Errors: bad input; no reconstruction where nothing can be adjusted.
Result<AdjustResult> adjust(const AdjustSettings& settings, const AdjustCallbacks& callbacks);

// Name of the adjusted model in the output folder: "sparse", or the name of the BAL file.
std::filesystem::path adjusted_name(const std::filesystem::path& input);

// Whether writing the results into `folder` would leave the input alone; else bad input.
Result<void> check_adjust_output(const std::filesystem::path& input, const std::filesystem::path& folder);

// Replaces what an older run left in the folder, as a whole or not at all, by the model in the form in which
// it was read, points.ply, config.yaml and report.json.
Result<void> write_adjust_output(const AdjustResult& result, const AdjustSettings& settings,
                                 const std::string& version, const std::filesystem::path& folder);

}  // namespace raysfm
