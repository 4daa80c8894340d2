#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/geometry/pose.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// Motion of a rig about the instant of a frame: tangent of rig_from_world (geometry/pose.h) per second. The
// pose t seconds later is retract(rig_from_world, t * velocity).
using Velocity = Eigen::Matrix<double, 6, 1>;

struct TimedPose {
  double time = 0;  // seconds
  Rigid3 rig_from_world;
};

// Velocity at a pose on the polynomial through it and other poses nearby, all at different times. Zero where
// there are none.
Velocity velocity_at(const TimedPose& pose, std::span<const TimedPose> others);

// By how much a rolling shutter moves what a camera sees from where it would be at the instant of the frame:
// points, in the rig's frame at that instant, that are seen at `pixels`. Zero where that cannot be told. All
// spans have one size.
void scan_offsets(const TrackingRig& rig, int camera, std::span<const Eigen::Vector3d> points_in_rig,
                  const Velocity& velocity, std::span<const Eigen::Vector2d> pixels,
                  std::span<Eigen::Vector2f> offsets);

// The same for a point of which it is not known at which pixel it is seen, to a hundredth of a pixel, but
// where it would be seen at the instant.
Eigen::Vector2f predict_scan_offset(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                                    const Velocity& velocity, const Eigen::Vector2d& at_instant);

// Pixels per second by which a point, in the rig's frame, moves in the image. Zero where it is not seen.
Eigen::Vector2d image_velocity(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                               const Velocity& velocity);

}  // namespace raysfm
