#pragma once

#include <string>
#include <vector>

#include "raysfm/boards/board_advice.h"
#include "raysfm/boards/calibrate_boards.h"
#include "raysfm/core/callbacks.h"
#include "raysfm/core/result.h"
#include "raysfm/settings/config.h"

namespace raysfm {

// What `raysfm camera calibrate` is told. Field names are those of the command line.
struct CalibrateSettings {
  std::vector<std::string> inputs;  // as those of `track`: several streams are the cameras of a rig
  std::string board = "9x6";        // inner corners along the sides of the chessboard
  double square = 0;                // side of a square, metres; 0: not told, places are in squares then
  std::string model = "auto";       // of the cameras; "auto": radtan or kannala-brandt
  double fps = 0;                   // frames per second of inputs without timestamps; 0: unknown
  int threads = 0;                  // 0: as many as the machine has
};

// What it gives.
struct CalibrateResult {
  BoardCalibration calibration;
  int images = 0;                  // looked at, over all cameras
  int found = 0;                   // of these, with the whole board
  int views = 0;                   // instants that were used: sharp ones that differ
  std::vector<std::string> notes;  // about the inputs
  std::vector<std::string> advice;
};

// All settings but the inputs. The fields point into `settings`.
std::vector<SettingField> setting_fields(CalibrateSettings& settings);

// What a caller hears while it runs: images done, of how many; -1: unknown.
using CalibrateCallbacks = Callbacks<int, int>;

// Cameras of images or videos of a chessboard. Of a long video the sharpest frame of each short while is
// looked at. Errors: bad input where the board is not found, the images differ in size or the views are too
// few; no reconstruction where they do not tell the cameras.
Result<CalibrateResult> calibrate(const CalibrateSettings& settings, const CalibrateCallbacks& callbacks);

// The camera file: standard deviations as comments, then the cameras.
std::string calibrated_camera_text(const CalibrateResult& result, const CalibrateSettings& settings);

}  // namespace raysfm
