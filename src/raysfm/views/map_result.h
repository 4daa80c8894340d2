#pragma once

#include <span>
#include <vector>

#include "raysfm/scene/map.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// Puts maps into a reconstruction whose frames and segments are there: its points, key frames, observations,
// their error and the scale of the main world. segment_of[m] is the segment of a map, -1 leaves it out.
// `frame` of a key frame is that of the reconstruction; where it is negative, the key frame is left out, and
// so are points that no other sees. Maps are freed one after another, so that no two copies of all are there.
void append_maps(const TrackingRig& rig, std::vector<Map> maps, std::span<const int> segment_of,
                 Reconstruction* out);

}  // namespace raysfm
