#pragma once

#include <optional>
#include <span>

#include "raysfm/places/meeting.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// The meeting of a key frame `here` with the world `there_world`, in which the pose of its very image is
// known too: `rig_from_there`. Points of that world's key frames `near`, which see about the same, are those
// of the corners where the pose expects them. None where too few are, or the worlds do not fit together.
// `here` and `there` may be one map.
std::optional<Meeting> meet_known(const TrackingRig& rig, const Map& here, const PlaceRef& place,
                                  const Map& there, int there_world, const Rigid3& rig_from_there,
                                  std::span<const int> near);

}  // namespace raysfm
