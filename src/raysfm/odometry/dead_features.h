#pragma once

#include "raysfm/odometry/view.h"
#include "raysfm/scene/map.h"

namespace raysfm {

// Takes the features out of a key frame that will never be matched again: those whose track has no position
// and was not seen in a later key frame. Tracks that never had a position are given up with them, and their
// numbers may be used again. For key frames that the newest does not follow any more.
void drop_dead_features(int keyframe, Map* map, KeyFrameView* view);

}  // namespace raysfm
