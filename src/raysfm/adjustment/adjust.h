#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include "raysfm/colmap_bal/bal_file.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/core/callbacks.h"
#include "raysfm/core/result.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/results/report_file.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/settings/config.h"

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

// What `adjust` gives.
struct AdjustResult {
  std::variant<BalFile, ColmapModel> model;  // adjusted; what is left out is as it was
  Reconstruction reconstruction;             // the same (Origin::kAdjust)
  Report report;                             // with `model` and `adjustment`
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

// Writes the results into the folder: write_output_folder() with config.yaml and the model in the form in
// which it was read.
Result<void> write_adjust_output(const AdjustResult& result, const AdjustSettings& settings,
                                 const std::string& version, const std::filesystem::path& folder);

}  // namespace raysfm
