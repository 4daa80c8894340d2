#pragma once

#include <optional>
#include <string>

#include "raysfm/views/tracking_rig.h"
#include "raysfm/views/view.h"

namespace raysfm {

// One line where the images of one instant say that the poses of the cameras in the rig are given in the
// opposite direction (cam_from_rig for rig_from_cam, the commonest mistake): hardly any corner meets its
// epipolar lines in the other cameras, but many do once each pose relative to the first camera is inverted.
// Nothing for cameras that share no view either way.
std::optional<std::string> opposite_extrinsics(const TrackingRig& rig, const View& view);

}  // namespace raysfm
