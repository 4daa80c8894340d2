#pragma once

#include <vector>

#include "raysfm/scene/map.h"

namespace raysfm {

// Median distance of a key frame's rig from the points that it sees; 0 where it sees none.
double median_distance(const MapKeyFrame& keyframe, const Map& map);

// How often each key frame of the map sees the points that one of them sees: itself too, and a point in two
// of its cameras twice.
std::vector<int> shared_observations(const Map& map, int keyframe);

}  // namespace raysfm
