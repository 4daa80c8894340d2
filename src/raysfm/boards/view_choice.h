#pragma once

#include <span>
#include <vector>

#include "raysfm/boards/board.h"

namespace raysfm {

// Indices of the views that differ from one another, ascending, at most `most` of them: the one that shows
// the largest board first, then always the one farthest from those chosen, up to those whose corners lie
// within `least_distance` of a chosen one's, in pixels, for every camera. Where no camera sees the board in
// both of two views, they differ.
std::vector<int> differing_views(std::span<const BoardView> views, double least_distance, int most);

}  // namespace raysfm
