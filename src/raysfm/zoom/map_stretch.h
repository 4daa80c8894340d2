#pragma once

#include <span>

#include "raysfm/lenses/point_tracks.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// Key frames in a row, and what they see of the points that most of them see, as the lens without its
// distortion would show it.
struct MapStretch {
  PointTracks tracks;
  UncalibratedReconstruction found;
};

// `lens`: of the one camera of the rig. `most_points`: those that most key frames see.
MapStretch stretch_of(const Reconstruction& r, const Lens& lens, std::span<const KeyFrame> keyframes,
                      size_t most_points);

// The key frames of each world.
std::vector<std::vector<KeyFrame>> keyframes_by_world(const Reconstruction& r);

}  // namespace raysfm
