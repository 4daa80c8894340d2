#pragma once

#include <optional>
#include <string>
#include <vector>

#include "raysfm/api/track.h"
#include "raysfm/calibration/rig_parameters.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/uncalibrated/reconstruct.h"
#include "raysfm/zoom/unzoomed_source.h"

namespace raysfm {

// A lens that no camera file told.
struct FoundLens {
  Rig rig;  // its camera, of the size of the frames, its pixels as wide as the input says; or all cameras
  CalibrationPrior prior;  // how far off it may be
  LensOrigin origin;
  bool told_apart = false;  // a perspective lens and one of another model were compared
  bool is_guess = false;    // only what its map says of it is asked for
  bool is_aside = false;    // its optical axis is farther from the middle of the images than is believed
  UndoneZoom zoom = {};     // the camera of `rig` is that of its canvas

  const Camera& camera() const { return rig.cameras[0]; }
};

// The one lens that was found in the footage, from so large a part of the images that it was looked for in.
// `first_frame`: that of the first image.
FoundLens lens_of_stretch(const UncalibratedReconstruction& found, const PointTracks& tracks, int first_frame,
                          double posed);

// What there is to say of a lens that the footage tells badly, for a map that does not tell it either; empty
// of others.
std::string vague_lens_warning(const LensOrigin& origin);

// What there is to say of a lens found by a model with k1 and k2 alone and compared with no other, where it
// is wider than these are good for; empty of others.
std::string wide_lens_warning(const Camera& camera);

// Bad input for a field of view out of range, or one that is told beside a camera file.
Result<void> check_fov(const TrackSettings& settings);

// What find_lens() hears of a zoom.
struct ZoomedStretch {
  int first_frame = -1, last_frame = -1;  // of the stretch that shows it; -1: none does
  // Of all that is there, as far as that stretch tells, or any that could be reconstructed; 0: none could.
  double keyframes = 0;

  bool is_seen() const { return last_frame >= 0; }
};

// The lens of a video without a camera file: from the first stretch of the footage that tells it well, else
// from the one that tells it best, else from the field of view that the settings tell, else from tracking.
// Reads the input, perhaps to its end. Errors: bad input, where one camera's footage is not what is given or
// it cannot be read twice; no reconstruction, where neither footage nor settings tell the lens, with the
// reason, or when told to stop. `zoom`, set whatever comes out: the stretch that looks as if the camera
// zoomed, if any; none after it is read.
Result<FoundLens> find_lens(const TrackSettings& settings, Input input, const TrackCallbacks& callbacks,
                            ZoomedStretch* zoom);

// Of the size of the frames and as square as their pixels, its principal point in the middle. `focal`:
// pixels.
Camera pinhole_camera(double focal, const FrameSource& source);

// The lens that maps tell which are tracked with others, over the beginning of the footage: from what a
// stretch says of it (`vague`, too little to be told), where the map tells one that is not far from that;
// else from a short and a long focal length, and on from where their maps end, where one comes to stay and
// the other leads there. It minds rolling shutters, which find_lens() does not, and needs no start without a
// lens. None where maps do not agree, or do not tell.
std::optional<FoundLens> lens_by_tracking(const TrackSettings& settings, const FrameSource& source,
                                          const std::optional<FoundLens>& vague,
                                          const TrackCallbacks& callbacks);

// The lens that the footage of one camera tells by itself; none where it tells none. `input`: whose first
// stream is the camera's. `is_alone`: it is all of the input, which may be tracked for it.
std::optional<FoundLens> own_lens(const TrackSettings& settings, Input input, bool is_alone,
                                  const TrackCallbacks& callbacks);

}  // namespace raysfm
