#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

#include "raysfm/image/image.h"

namespace raysfm {

// Side of a pixel of an octave in pixels of the image as taken. It is also what one standard deviation of a
// position found there counts for: corners and patches are as exact in pixels of their octave at every scale.
inline float octave_side(int octave) {
  return static_cast<float>(1 << octave);
}

// The same place in the pixels of an octave, and back.
inline Eigen::Vector2f into_octave(const Eigen::Vector2f& pixel, int octave) {
  return ((pixel.array() + 0.5f) / octave_side(octave) - 0.5f).matrix();
}
inline Eigen::Vector2f out_of_octave(const Eigen::Vector2f& pixel, int octave) {
  return ((pixel.array() + 0.5f) * octave_side(octave) - 0.5f).matrix();
}

// A picture at the resolutions at which it has something to say. Octave 0 is the image as taken, each further
// one the half_sample() of the one before; those finer than the picture is sharp are left out.
class Octaves {
 public:
  Octaves() = default;
  // Keeps `image` where octave 0 is needed. The first octave is the finest of at most `max_pixels` pixels in
  // which edges are no wider than kSoftEdge, and along a motion than kMotionBlur (sharpness.h). Noise is
  // subdued first (image/noise.h).
  Octaves(GrayImage image, int max_pixels);

  // A copy without the finest octaves, but never without any.
  Octaves without_finest(int octaves) const;
  // What the pictures take.
  size_t bytes() const;

  // Mean width of edges in the first octave that there was at the beginning, in its pixels; 0 where nothing
  // tells it.
  float softness() const { return softness_; }
  // To what width, at least, the camera's motion drew edges out in the first octave: 0.4 of how far they
  // moved during the exposure, less where noise hides it. Pixels of the image as taken; 0 where nothing tells
  // it.
  float motion_blur() const { return motion_blur_; }

  int first() const { return first_; }
  int last() const { return first_ + static_cast<int>(images_.size()) - 1; }
  int clamp(int octave) const { return std::clamp(octave, first(), last()); }
  GrayView at(int octave) const { return images_[octave - first_].view(); }
  // All of them, first() first.
  std::vector<GrayView> views() const;

 private:
  int first_ = 0;
  float softness_ = 0;
  float motion_blur_ = 0;
  std::vector<GrayImage> images_;
};

}  // namespace raysfm
