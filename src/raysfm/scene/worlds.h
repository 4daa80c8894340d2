#pragma once

#include <vector>

#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// A world is what shares one frame and one scale: a segment. The segments with a pose, first the main one,
// which has the most posed frames (the first of equals), then the others in time order.
std::vector<int> worlds_in_order(const Reconstruction& reconstruction);

// One segment alone: its frames with a pose, its key frames, observations and points, all numbered anew. The
// error of reprojection is that of the whole.
Reconstruction world_of(const Reconstruction& reconstruction, int segment);

// Frames from `first` to `last`, both included.
struct FrameRun {
  size_t first = 0, last = 0;
};

// The frames of which only the turning was seen.
std::vector<FrameRun> place_held_runs(const std::vector<PosedFrame>& frames);

// Frames with a pose.
int posed_count(const Reconstruction& reconstruction);
// Those of which more than how they turned is known.
int placed_count(const Reconstruction& reconstruction);

}  // namespace raysfm
