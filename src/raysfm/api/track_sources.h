#pragma once

#include <optional>
#include <string>
#include <vector>

#include "raysfm/api/track.h"
#include "raysfm/calibration/rig_parameters.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/image/image.h"
#include "raysfm/saved_map/saved_map.h"
#include "raysfm/zoom/unzoomed_source.h"

namespace raysfm {

// What a run works on, opened and found to fit together.
struct Sources {
  Input input;
  Rig rig;
  std::vector<GrayImage> masks;  // by camera; empty: none is given
  LensOrigin origin;
  CalibrationPrior prior;
  double find_ms = 0;           // that finding the lens took
  bool may_be_fisheye = false;  // nothing tells whether the lens that was found is none
  UndoneZoom undone_zoom = {};  // of the one stream
  // Of a lens that no file told.
  struct {
    bool may_be = false, may_be_solved = false;  // asked of the map; and solve() then
    std::optional<TrackResult> solved;           // with a lens for each image
    std::string warning;                         // of signs that came to nothing
  } zoom = {};

  bool lens_is_given() const { return origin.source == "camera file"; }
};

// Opens what the settings name, and finds the lens where no file tells it. `known`: the saved map to go on
// from, if any. `found`: the lens, where somebody else has found it; else null. Errors: bad input; no
// reconstruction, where nothing tells the lens, or when told to stop.
Result<Sources> open_sources(const TrackSettings& settings, const std::optional<SavedMap>& known,
                             const FoundLens* found, const TrackCallbacks& callbacks);

// Opens the inputs of the settings, once more. `lens_is_found`: whatever calibration lies beside the images.
Result<Input> open_inputs(const TrackSettings& settings, bool lens_is_found = false);

}  // namespace raysfm
