#pragma once

#include "raysfm/scene/map.h"
#include "raysfm/views/fixed_marks.h"
#include "raysfm/views/view.h"

namespace raysfm {

// Takes the features out of a key frame that will never be matched again: those whose track has no position
// and was not seen in a later key frame. Tracks that never had a position are given up with them, and their
// numbers may be used again. For key frames that the newest does not follow any more. With `for_good`, of a
// key frame whose images are forgotten, only what the map stands on stays: inliers of points.
void drop_dead_features(int keyframe, bool for_good, Map* map, KeyFrameView* view);

// Gives up the tracks that were seen about marks more often than elsewhere: no key frame sees them any more.
void give_up_marks(const FixedMarks& marks, Map* map);

}  // namespace raysfm
