#pragma once

#include "raysfm/places/described.h"
#include "support/true_map.h"

namespace raysfm::testing_support {

// A map whose poses and points are the truth, and whose key frames can be recognised.
inline TrueMap described_map(const PanelWorld& world, int keyframes) {
  TrueMap out = true_map(world, keyframes);
  Describer describer;
  for (int k = 0; k < keyframes; ++k) {
    describe_keyframe(out.map, *out.views[k].view, describer, &out.map.keyframes[k]);
  }
  return out;
}

}  // namespace raysfm::testing_support
