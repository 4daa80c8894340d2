#pragma once

#include "raysfm/scene/map.h"
#include "raysfm/views/rolling_shutter.h"
#include "raysfm/views/view.h"

namespace raysfm {

// Works out anew by how much the rolling shutter moved the features of a key frame from `first` on, from the
// positions that their tracks have, or else at the median distance of the others. What moves by less than a
// five-hundredth of a pixel stays. The rays of `view`, that of the key frame where it is given, follow. Does
// nothing where no camera of the rig has a rolling shutter.
void correct_scan(const TrackingRig& rig, const RigMotion& motion, int first, int keyframe, Map* map,
                  KeyFrameView* view = nullptr);

// Sets that of one feature.
void set_scan_offset(const TrackingRig& rig, int feature, const Eigen::Vector2f& offset,
                     MapKeyFrame* keyframe);

}  // namespace raysfm
