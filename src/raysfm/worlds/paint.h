#pragma once

#include <functional>

#include "raysfm/worlds/materials.h"

namespace raysfm::synth {

// How to paint one pattern: texels per period and the colour at (u, v) in [0, 1)^2, u to the right and v
// down.
struct Painter {
  int side;
  std::function<Colour(float u, float v)> paint;
};

// `noise` must outlive the painter.
Painter painter(Pattern pattern, int variant, const Texture& noise);

// Speckles of `noise` repeated `times` times over a period, in [-0.5, 0.5].
inline float speckle(const Texture& noise, float u, float v, float times, int channel) {
  return noise.sample(times * u, times * v, 0.f)[channel] / 255.f - 0.5f;
}

// The two families, in files of their own: those that repeat, and those fitted to their surface.
Painter repeating_painter(Pattern pattern, uint32_t seed, const Texture& noise);
Painter fitted_painter(Pattern pattern, uint32_t seed, const Texture& noise);

}  // namespace raysfm::synth
