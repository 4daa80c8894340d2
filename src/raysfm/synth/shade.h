#pragma once

#include "raysfm/synth/scene.h"

namespace raysfm::synth {

// What the rays of a row meet, as Scene::trace tells it. Every array is readable for kRayPack numbers behind
// rays.count.
struct SightRow {
  RayRow rays;
  const float* distance;
  const int32_t* surface;
  const float* spread;  // radians between neighbouring rays
};

// Red, green and blue, grey levels; room for kRayPack numbers behind the row.
struct ColourRow {
  float *red, *green, *blue;
};

// Colour of the nearest surface or of the sky; black where there is neither and for rays that see nothing.
void shade(const World& world, const Scene& scene, const SightRow& sights, const ColourRow& colours);

}  // namespace raysfm::synth
