#pragma once

#include "raysfm/scene/map.h"

namespace raysfm {

// Numbers the key frames of a map the other way round, as if time had run backwards. Observations of tracks
// stay in the order of their key frames. A scale that is held is held between the same two ends, as they are.
void reverse_keyframes(Map* map);

}  // namespace raysfm
