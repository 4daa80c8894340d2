#pragma once

#include <optional>
#include <string>

#include "raysfm/api/track.h"
#include "raysfm/calibration/rig_parameters.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// A lens that no camera file told.
struct FoundLens {
  Camera camera;           // square pixels, of the size of the frames
  CalibrationPrior prior;  // how far off it may be
  LensOrigin origin;
  bool told_apart = false;  // a perspective lens and one of another model were compared
};

// Part of the images of a reconstruction that have a pose.
double posed_share(const UncalibratedReconstruction& found);

// The one lens that was found in the footage, from so large a part of the images that it was looked for in.
// `first_frame`: that of the first image.
FoundLens lens_of_stretch(const UncalibratedReconstruction& found, const PointTracks& tracks, int first_frame,
                          double posed);

// What there is to say of a lens found by a model with k1 and k2 alone and compared with no other, where it
// is wider than these are good for; empty of others.
std::string wide_lens_warning(const Camera& camera);

// Bad input for a field of view out of range, or one that is told beside a camera file.
Result<void> check_fov(const TrackSettings& settings);

// What find_lens() hears of a zoom.
struct ZoomedStretch {
  int first_frame = -1, last_frame = -1;  // of the stretch that shows it; -1: none does
  double keyframes = 0;                   // of all that is there, as far as the stretch tells
};

// The lens of a video without a camera file: from the first stretch of the footage that tells it well, else
// from the one that tells it best, else from the field of view that the settings tell. Reads the input,
// perhaps to its end. Errors: bad input, where one camera's footage is not what is given or it cannot be read
// twice; no reconstruction, where neither footage nor settings tell the lens, with the reason, or when told
// to stop. `zoom`, set whatever comes out: the stretch that looks as if the camera zoomed, if any; none after
// it is read.
Result<FoundLens> find_lens(const TrackSettings& settings, Input input, const TrackCallbacks& callbacks,
                            ZoomedStretch* zoom);

}  // namespace raysfm
