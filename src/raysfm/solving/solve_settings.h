#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "raysfm/core/callbacks.h"
#include "raysfm/core/result.h"
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

// Whether they are allowed, alone and with one another; else bad input that names the setting.
Result<void> validate(SolveSettings settings);

// What a caller hears while `solve` runs. Its progress: what is being done, e.g. "frame", how many of them
// are done, and of how many; -1: unknown.
using SolveCallbacks = Callbacks<const char*, int, int>;

}  // namespace raysfm
