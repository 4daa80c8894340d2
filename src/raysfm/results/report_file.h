#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/core/timer.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

constexpr uintmax_t kMaxReportBytes = 1u << 30;  // larger ones are not read

// The adjustment of everything at once that `solve` ends with, and `adjust` is.
struct AdjustmentReport {
  std::string method = {};
  double initial_cost = 0, final_cost = 0;  // half the sum of squared residuals, the loss applied
  int iterations = 0;
  std::string termination = {};
  double read_s = 0, solve_s = 0;
};

// What the EXIF of photos says of a lens that they were taken with.
struct ExifLens {
  std::string camera = {}, lens = {};  // empty: not said
  double focal_mm = 0;                 // 0: not said
  int photos = 0;
  std::string first_photo = {};
  double focal_px = 0, focal_sigma_px = 0;  // 0: not told
  std::string source = {};                  // what that was worked out from
  std::string not_used = {};                // why the focal length is not used; empty: it is
};

// What `solve` found out about the lens.
struct LensReport {
  bool zooming = false;
  std::string evidence = {};
  std::string degenerate = {};  // empty, or the name of the motion or scene that does not tell the lens
  int width = 0, height = 0;    // of the images; where they differ, the largest of each
  std::vector<ExifLens> exif = {};
  double gain = 0;           // rms with one lens to that with one for each image; 0: these were not compared
  double spread = 0;         // standard deviation of the logarithm of the focal length then
  bool zoom_undone = false;  // the video was tracked with the zoom undone: it made the result
};

// Where `track` has the lens from.
struct LensOrigin {
  std::string source = "camera file";     // or "footage", or "told field of view"
  double told_fov_deg = 0;                // horizontal; 0: none was told
  int first_frame = -1, last_frame = -1;  // that told the lens; -1: none did
  double focal = 0, focal_sigma = 0;      // pixels, as it was found or told; the second a part of the first
  std::string model = {};                 // of the first camera, as camera files name it; empty: not said
  std::string not_told = {};              // why the footage does not tell the lens, where it was asked
};

// The model of another tool that `adjust` worked on.
struct ModelReport {
  std::string format = {};  // "bal" or "colmap"
  std::string name = {};    // of the file or folder, in the output folder
  std::string loss = {};
  double loss_scale_px = 0;
  bool refines_intrinsics = false;
  int cameras = 0;
  int used_observations = 0, dropped_observations = 0;
  int images_left_out = 0;  // without an observation that takes part
  int points_left_out = 0;  // seen by fewer than two images
  bool kept_start = false;  // the adjustment would have raised the cost, so the model is as it was
  double initial_rms_px = 0;
};

// What report.json says beyond the reconstruction itself.
struct Report {
  std::string version;
  uint64_t seed = 0;
  std::vector<std::string> input;     // as the user gave it
  std::string camera_class;           // "central", "axial", "non-axial" or "non-central"
  std::string error;                  // "pixel" or "angular"
  std::vector<std::string> warnings;  // of `track`: what the run as a whole says against its result
  bool interrupted = false;           // the input had more
  int frames_in_input = -1;           // -1: unknown
  std::vector<std::string> files;     // of the output folder
  std::vector<std::pair<std::string, StageTiming>> stages;  // in order of appearance, e.g. {"detect", ...}
  double wall_s = 0;
  double frames_per_second = 0;
  double peak_rss_mib = 0;
  std::optional<AdjustmentReport> adjustment = {};
  std::optional<LensReport> lens = {};
  std::optional<LensOrigin> lens_origin = {};
  std::optional<ModelReport> model = {};
};

// Text of report.json. Numbers of frames, key frames, points and observations, the cameras, the segments, the
// starts and the reasons of frames without a pose come from the reconstruction. `start` is that of the first
// segment, `starts` holds those of all segments. `scale` is that of the main world, which `worlds` begins
// with; the others follow in time order.
std::string report_json(const Reconstruction& reconstruction, const Report& report);

// Writes report_json(). Errors: bad input, naming the file.
Result<void> write_report(const Reconstruction& reconstruction, const Report& report,
                          const std::filesystem::path& path);

}  // namespace raysfm
