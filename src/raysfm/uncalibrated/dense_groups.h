#pragma once

#include <vector>

#include "raysfm/lenses/point_tracks.h"

namespace raysfm {

// Groups of images in no order that see much of one another, from each of which a reconstruction can start:
// at most `count` groups of at most `size` images, ascending. A later group begins with an image that no
// earlier one has.
std::vector<std::vector<int>> dense_groups(const PointTracks& tracks, int size, int count);

}  // namespace raysfm
