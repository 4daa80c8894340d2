#pragma once

#include <vector>

#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Where a world is held together by few points: only those that two key frames before and two after see tell
// what comes after how long what was before is.
struct WeakLink {
  int first = 0, last = 0;  // frames: the key frames before and after
  int points = 0;           // at the weakest place between them
  double usual = 0;         // points in the median of all places of the world
};

// In the order of their frames, of worlds whose scale is not metric: a rig knows how long things are. A weak
// link has under 50 points and under a tenth of the usual.
std::vector<WeakLink> weak_links(const Reconstruction& reconstruction);

}  // namespace raysfm
