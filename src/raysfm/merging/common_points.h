#pragma once

#include <span>
#include <vector>

#include "raysfm/scene/map.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// A key frame of one map whose very image another run has seen: its pose in the map of that run.
struct KnownPose {
  int keyframe = 0;
  Rigid3 rig_from_other;
};

// A map as one run left it, the rig that it is in, and which of its key frames the other run has posed.
struct PosedByOther {
  const TrackingRig& rig;
  const Map& map;
  std::span<const KnownPose> known;
};

// A point that two maps have, by an observation of its track in each.
struct CommonPoint {
  TrackObservation of_a, of_b;
};

// The points that two maps of one video have in common. Both runs have seen the same images, so that a point
// of one is that of the other where each is seen, in the images of the other, at the pixels that are the
// other's. Each map's own cameras tell that: what one made of its lens does not concern the other. A track is
// in one of the pairs at most.
std::vector<CommonPoint> find_common_points(const PosedByOther& a, const PosedByOther& b);

}  // namespace raysfm
