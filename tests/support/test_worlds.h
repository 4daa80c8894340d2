#pragma once

#include "raysfm/synth/renderer.h"
#include "raysfm/worlds/world.h"

namespace raysfm::synth {

// A world of nothing, to put single surfaces into.
inline World empty_world(ThreadPool& pool) {
  World world;
  world.materials = std::make_shared<MaterialLibrary>(pool);
  return world;
}

inline Finish finish_of(World& world, Pattern pattern) {
  Finish f;
  f.texture = world.materials->find(pattern, 0);
  f.period = period_of(pattern);
  return f;
}

inline Camera pinhole(int width, int height, double f) {
  Camera camera;
  camera.name = "camera";
  camera.model = Pinhole{f, f, 0.5 * (width - 1), 0.5 * (height - 1)};
  camera.width = width;
  camera.height = height;
  return camera;
}

inline Motion stand_at(const Rigid3& world_from_rig) {
  return [world_from_rig](double) { return world_from_rig; };
}

}  // namespace raysfm::synth
