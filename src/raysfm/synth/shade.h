#pragma once

#include "raysfm/synth/scene.h"

namespace raysfm::synth {

// What one ray sees, relative to a scene's origin and in the world's axes.
struct Sight {
  Eigen::Vector3f start, direction;
  float distance;
  int surface;   // -1: nothing
  float spread;  // radians between neighbouring rays
};

// Colour of the nearest surface or of the sky, grey levels.
Colour shade(const World& world, const Scene& scene, const Sight& sight);

}  // namespace raysfm::synth
