#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "raysfm/calibration/calibration_refiner.h"
#include "raysfm/core/result.h"
#include "raysfm/robust/generic_start.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// How everything is adjusted at the end, where that is asked for.
enum class FinalAdjustment : uint8_t {
  kGlobal,        // from where it is
  kHierarchical,  // halves of halves first, for maps that are bent (LBA09 2.6)
};

// What is done beyond LBA09 and can be left out to see what it brings; docs/architecture.md says why it is
// done.
struct Departures {
  bool blur = true;       // views that moved while they were exposed are followed by larger patches
  bool earlier = true;    // views before those of a start become key frames too
  bool keyframes = true;  // a key frame is due once the camera has moved, beside the rules of 2.4
  bool noise = true;      // adjustments are by a loss as wide as suits the noise
  bool parallax = true;   // points of little parallax wait for more of it
  bool surfaces = true;   // patches are deformed as the surfaces about them lie
  bool turning = true;    // what only turns where nothing is known keeps its orientation
};

// Leaves out those named, separated by commas. Errors: a name that is none, with those that are.
Result<void> leave_out(std::string_view names, Departures* departures);
// All of them.
constexpr Departures kNoDepartures{false, false, false, false, false, false, false};

// Settings of the calibrated pipeline. The defaults are those of LBA09 where the paper gives one.
struct OdometryOptions {
  int features = 1500;     // corners per frame (2.1); >= 50
  int free_cameras = 3;    // n, key frames refined by a local adjustment (2.5); >= 1
  int window = 10;         // N, key frames whose observations it uses; >= n + 2
  int global_until = 20;   // N_f, key frames up to which everything is refined; >= 3
  int min_matches = 400;   // M of 2.2 and 2.4; scaled down where images have fewer corners; >= 30
  int min_matches3 = 300;  // M' of 2.2
  // Local adjustments as in 2.5 to the letter: all key frames up to N_f with each of them, then N and none
  // that is older; N may be n or n + 1, which leaves the scale at the end free (5.3).
  bool paper_window = false;
  Departures departures = {};
  ErrorMeasure error = ErrorMeasure::kAuto;
  GenericStartMethod start = GenericStartMethod::kAuto;  // how the first three views are posed
  LensRefinement refine_lens = LensRefinement::kAuto;
  CalibrationPrior calibration_prior = {};  // of the cameras given
  bool loops = true;  // places seen before are recognised: loops are closed, worlds joined
  // Key frames of a map up to which all of them stay. Beyond, where loops are closed, most of those go again
  // that saw what was known before.
  int keep_all_until = 1000;
  // Seconds from a frame beyond which another says nothing of how fast the rig moves at it.
  double velocity_reach = 0.25;
  // What the images of views may take that wait for a start. When they take more, every second of the older
  // ones is released, and coarser images stand for it.
  size_t waiting_bytes = size_t{56} << 20;
  bool starts_worlds = true;  // else only worlds of earlier runs are tracked in
  // Else nobody asks for maps: they stay as the last calibration left them.
  bool finishes_maps = true;
  FinalAdjustment final = FinalAdjustment::kGlobal;
  uint64_t seed = 0;
};

// Names the field, the value and what is allowed.
Result<void> validate(const OdometryOptions& options);

}  // namespace raysfm
