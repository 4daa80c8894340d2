#pragma once

#include <array>
#include <vector>

#include "raysfm/lenses/point_tracks.h"

namespace raysfm {

// Threes of images from which a reconstruction of photos, which see one another in any order, may start: some
// hundred at most, of images that see many points, with their neighbours. The first and the last of each see
// the fewest points in common, the one between them is the second. `of_image`: the observations of each
// image.
std::vector<std::array<int, 3>> threes_in_sight(const PointTracks& tracks,
                                                const std::vector<std::vector<int>>& of_image);

}  // namespace raysfm
