#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/callbacks.h"
#include "raysfm/core/result.h"
#include "raysfm/results/report_file.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/settings/config.h"

namespace raysfm {

// What `raysfm solve` is told. Field names are those of the command line and of --config.
struct SolveSettings {
  std::string input;                // video, image folder or pattern, sequence folder, or CSV of point tracks
  std::string camera;               // file of the one camera that took all images; empty: the lens is unknown
  std::string lens = "auto";        // "auto", "fixed" or "zoom"
  std::string distortion = "auto";  // "auto", "none" or "radial"
  std::string method = "polished";  // "intrinsics-free", "standard" or "polished"
  std::string constraints = "weights";  // "weights" or "lagrange"
  std::string images = "auto";          // "auto", "video" or "photos"
  std::string size;       // of the images, "WIDTHxHEIGHT", for tracks in a file; empty: guessed from them
  std::string structure;  // CSV of known positions of the points of a file of tracks; empty: none known
  double fps = 0;         // frames per second of inputs without timestamps; 0: unknown
  TimeRange range;        // the part of a video that is read
  int features = 1500;    // corners in an image, > 0
  double max_error = 3;   // pixels, of an inlier; > 0
  int threads = 0;        // 0: as many as the machine has; never changes a result
  uint64_t seed = 0;
};

// All settings but the input. The fields point into `settings`.
std::vector<SettingField> setting_fields(SolveSettings& settings);

// What a caller hears while `solve` runs. Its progress: what is being done, e.g. "frame", how many of them
// are done, and of how many; -1: unknown.
using SolveCallbacks = Callbacks<const char*, int, int>;

// What `solve` gives: structure, motion and lenses (Origin::kSolve), or the camera that was given
// (Origin::kTrack). There is one world, the camera of the first frame with a pose, its scale arbitrary,
// unless it is given by known structure: `metric_scale` then means its unit.
struct SolveResult {
  Reconstruction reconstruction;
  Report report;  // with `lens` and `adjustment`, where no camera was given
};

// Unknown or zooming lens (IFBA01), or photos of a known camera. Errors: bad input; no reconstruction with
// the reason.
Result<SolveResult> solve(const SolveSettings& settings, const SolveCallbacks& callbacks);

// Whether writing the results into `folder` would leave the input alone; else bad input.
Result<void> check_solve_output(const std::filesystem::path& input, const std::filesystem::path& folder);

// Writes the results into the folder: write_output_folder() with config.yaml and lens.png.
Result<void> write_solve_output(const SolveResult& result, const SolveSettings& settings,
                                const std::string& version, const std::filesystem::path& folder);

}  // namespace raysfm
