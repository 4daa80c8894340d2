#pragma once

#include <cstdint>
#include <optional>

#include "raysfm/camera/camera.h"
#include "raysfm/lenses/point_tracks.h"

namespace raysfm {

struct TurnLensOptions {
  double max_error_px = 2;     // of a match that agrees
  double centre_sigma = 0.03;  // of the principal point about the middle, part of the image's larger side
  uint64_t seed = 0;
};

// The lens of a camera that turns about its centre, and standard deviations of its numbers.
struct TurnLens {
  Camera camera;            // square pixels: radtan with k1 and k2, or kannala-brandt with these
  double focal_sigma = 0;   // part of the focal length
  double centre_sigma = 0;  // part of the image's larger side, of the less well known coordinate
  double explained = 0;     // part of the matches of all pairs that agree with turns
};

// Finds the lens through which rotations explain how points move from image to image (Hartley,
// "Self-calibration from multiple views with a rotating camera", ECCV 1994): rotations of pairs of images and
// numbers of the lens together, in pixels. Pairs between which the camera moved are left out; what is left of
// parallax, and a rolling shutter, count as errors that are alike within a pair, so that standard deviations
// are those of pairs that err each as a whole. `tracks`: valid, images in time order. None where fewer than
// four pairs of images do nothing but turn.
std::optional<TurnLens> lens_of_turn(const PointTracks& tracks, const TurnLensOptions& options);

}  // namespace raysfm
