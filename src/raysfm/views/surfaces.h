#pragma once

#include "raysfm/scene/map.h"
#include "raysfm/views/tracking_rig.h"
#include "raysfm/views/view.h"

namespace raysfm {

// Lays a plane through the point of each feature of a key frame and the points seen about it, and turns the
// feature's surface into it (KeyFrameView::point_jacobians). What has no position, or no neighbours, faces
// the camera as before. Floors and walls beside a wide camera are seen at a slant, and patches deformed as if
// they faced it are found beside their place, to a side that goes with the scale and with the lens.
void fit_surfaces(const TrackingRig& rig, const Map& map, int keyframe, KeyFrameView* view);

}  // namespace raysfm
