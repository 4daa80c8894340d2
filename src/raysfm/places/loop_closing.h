#pragma once

#include "raysfm/geometry/similarity.h"
#include "raysfm/scene/map.h"

namespace raysfm {

// The end of a map is where its beginning is: what two of its key frames see of one place.
struct LoopClosure {
  int here = 0, there = 0;      // key frames, the later one first
  Similarity3 there_from_here;  // of their rigs: a scale that is not 1 has drifted
};

// Spreads the drift along a loop over the key frames of a map by a graph of similarities, of rigid motions
// where the scale is known, and takes the points with them. Key frame 0 stays.
void close_loop(const LoopClosure& loop, bool scale_is_known, Map* map);

}  // namespace raysfm
