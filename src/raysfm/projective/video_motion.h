#pragma once

#include <span>
#include <string>

#include "raysfm/lenses/point_tracks.h"

namespace raysfm {

// How well simple motions explain the matches of images far apart: shares of the matches that agree with an
// epipolar geometry, in [0, 1], which three quarters of the pairs exceed.
struct MotionShares {
  double homography = 0;  // also agree with a homography: a turning camera, or a plane
  double turn = 0;  // the same to the error of an inlier, through one lens that may bend lines; half of the
                    // pairs exceed it
  double rotation = 0;     // of pairs whose homography then has the eigenvalues of a rotation
  double translation = 0;  // also move along lines through one point: no rotation
  double moved = 0;        // median of pairs of the median displacement, share of the image's larger side
  int pairs = 0;
};

// Of pairs of `images` that are as far apart as tracks allow. `max_error_px` of an inlier.
MotionShares motion_shares(const PointTracks& tracks, std::span<const int> images, double max_error_px,
                           uint64_t seed);

// The motion or scene that leaves structure and lens undetermined whatever is done, and why, or empty.
struct HopelessMotion {
  std::string name;  // as name_degeneracy() has it, or "no motion"
  std::string why;
};
HopelessMotion hopeless_motion(const MotionShares& shares);

// Whether a turn explains so much that what else there is may be anything: a rolling shutter, a hand.
bool nearly_turns(const MotionShares& shares);

}  // namespace raysfm
