#pragma once

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Pose of a camera (or rig) that has gone `part` of the way from pose a to pose b of the same frames: its
// centre moves straight, it turns at a constant rate, the shorter way. A camera that turns in one place stays
// there. `part` from 0 (a) to 1 (b); below and above, beyond them.
inline Rigid3 interpolate(const Rigid3& a_from_world, const Rigid3& b_from_world, double part) {
  const Rigid3 world_from_a = a_from_world.inverse(), world_from_b = b_from_world.inverse();
  const Rigid3 world_from_cam{world_from_a.rotation.slerp(part, world_from_b.rotation),
                              (1 - part) * world_from_a.translation + part * world_from_b.translation};
  return world_from_cam.inverse();
}

}  // namespace raysfm
