#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/scene/map.h"

namespace raysfm {

// Key frames of places that were mapped before: a map that has seen a place twice is little better with all
// of the second look, and a third and a tenth would make it grow without end.

// Of the key frames [begin, end), by number from `begin`: 1 where a large part of the points that it sees was
// seen by key frames more than `apart` before it.
std::vector<uint8_t> second_looks(const Map& map, int begin, int end, int apart);

// Takes key frames out of a map (1: goes; shorter: the rest stays), and with them the points that hardly
// anything else sees. Nothing but key frames that go and those before the last of these may name such points.
// The first key frame and the one that the scale hangs on must stay. Returns, by the old number, that of each
// key frame, or of the one before it that stayed.
std::vector<int> drop_keyframes(std::span<const uint8_t> goes, Map* map);

}  // namespace raysfm
