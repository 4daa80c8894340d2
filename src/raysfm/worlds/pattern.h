#pragma once

#include <cmath>
#include <cstdint>

#include "raysfm/worlds/texture.h"

namespace raysfm::synth {

// Well mixed bits of a lattice point: the one source of variety in every painted pattern.
inline uint32_t hash(int x, int y, uint32_t seed) {
  uint32_t h =
      static_cast<uint32_t>(x) * 0x8da6b343u ^ static_cast<uint32_t>(y) * 0xd8163841u ^ seed * 0xcb1ab31fu;
  h = (h ^ h >> 16) * 0x7feb352du;
  h = (h ^ h >> 15) * 0x846ca68bu;
  return h ^ h >> 16;
}

// The same as a number in [0, 1).
inline float chance(int x, int y, uint32_t seed) {
  return static_cast<float>(hash(x, y, seed) >> 8) * 0x1p-24f;
}

inline float smoothstep(float low, float high, float x) {
  const float t = std::fmin(std::fmax((x - low) / (high - low), 0.f), 1.f);
  return t * t * (3.f - 2.f * t);
}

// Whole cell and position in it, of a coordinate in a lattice of `count` cells per period; the cell wraps.
struct Cell {
  int index;
  float position;  // [0, 1)
  Cell(float x, int count) {
    const float scaled = x * static_cast<float>(count);
    const float whole = std::floor(scaled);
    position = scaled - whole;
    index = static_cast<int>(whole) % count;
    if (index < 0) index += count;
  }
};

// Sum of octaves of value noise with period 1 in u and v: lattices of first, 2 first, ... cells, each octave
// `gain` times the one before. Mean about 0.5, mostly within [0.1, 0.9].
float fractal_noise(float u, float v, int first, int octaves, float gain, uint32_t seed);

// Three independent fractal noises, one per channel: the common ground of all patterns and the weathering
// laid over every surface.
Texture make_noise_texture(uint32_t seed, ThreadPool& pool, std::shared_ptr<TexelStore> store);

}  // namespace raysfm::synth
