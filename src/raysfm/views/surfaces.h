#pragma once

#include <cstdint>

#include "raysfm/scene/map.h"
#include "raysfm/views/tracking_rig.h"
#include "raysfm/views/view.h"

namespace raysfm {

// Of which of the points that a key frame sees: those that no earlier one sees are mostly looked for with its
// patches.
enum class SurfacesOf : uint8_t { kAll, kFirstSeen };

// Lays a plane through the point of each feature of a key frame and the points seen about it, and turns the
// feature's surface into it (KeyFrameView::point_jacobians). What has no position, or no neighbours, faces
// the camera as before. Floors and walls beside a wide camera are seen at a slant, and patches deformed as if
// they faced it are found beside their place, to a side that goes with the scale and with the lens.
void fit_surfaces(const TrackingRig& rig, const Map& map, int keyframe, SurfacesOf which, KeyFrameView* view);

}  // namespace raysfm
