#pragma once

#include <span>
#include <vector>

#include "raysfm/scene/reconstruction.h"
#include "raysfm/zoom/unzoomed_source.h"

namespace raysfm {

// The logarithm of the focal length of a frame, in pixels.
struct FocalMeasurement {
  int frame = 0;
  double log_focal = 0;
  double sigma = 0;
};

// How the focal length of a video changes from frame to frame: evenly, its slope by as much as is likeliest,
// but for jumps where it is switched.
class ZoomCurve {
 public:
  // From rough values at some of `frames` frames, in their order. They err from one to the next, by what they
  // scatter about lines through their neighbours (their own `sigma` is not looked at), and all of a stretch
  // by one factor, which wanders.
  ZoomCurve(int frames, std::span<const FocalMeasurement> rough);

  // Logarithms of the focal lengths of all frames, as far as the rough values tell them and what was measured
  // better at some, in their order, perhaps at none.
  std::vector<double> log_focals(std::span<const FocalMeasurement> measured) const;

 private:
  std::vector<double> rough_, sigma_;  // by frame; the second infinite where there is nothing
  std::vector<bool> jumps_;            // from the frame before
};

// Those of a solution with a lens for each frame that has a pose.
std::vector<FocalMeasurement> focals_of(const Reconstruction& solved);

// The canvas for focal lengths: that of the longest, or of twice the shortest if that is less, and as large
// as the widest frame then is.
UndoneZoom undo_zoom(std::span<const double> log_focals, int width, int height);

// The focal lengths of key frames by the map that was tracked with the zoom undone, from adjustments of
// stretches in which each has its own; in the order of the frames. `tracked`: with one perspective camera.
// Empty without any stretch.
std::vector<FocalMeasurement> measure_focals(const Reconstruction& tracked, const UndoneZoom& zoom);

}  // namespace raysfm
