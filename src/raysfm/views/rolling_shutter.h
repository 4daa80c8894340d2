#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/geometry/pose.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// Motion of a rig about the instant of a frame: tangents of rig_from_world (geometry/pose.h) per second, and
// per second squared. The pose t seconds later is retract(rig_from_world, after(t)). A hand shakes at a few
// hertz: over half of a readout of 33 ms its acceleration takes a pixel as far as a velocity does that is a
// few per cent off.
struct RigMotion {
  using Tangent = Eigen::Matrix<double, 6, 1>;

  Tangent velocity = Tangent::Zero(), acceleration = Tangent::Zero();

  Tangent after(double seconds) const { return seconds * (velocity + 0.5 * seconds * acceleration); }
  Tangent velocity_after(double seconds) const { return velocity + seconds * acceleration; }
};

struct TimedPose {
  double time = 0;  // seconds
  Rigid3 rig_from_world;
};

// Motion at a pose: velocity on the polynomial through it and other poses nearby, all at different times;
// zero where there are none. Acceleration on the parabola through it and the farthest before and after it:
// that of the polynomial has five times as much of the poses' noise. Zero where they are all on one side.
RigMotion motion_at(const TimedPose& pose, std::span<const TimedPose> others);

// By how much a rolling shutter moves what a camera sees from where it would be at the instant of the frame:
// points, in the rig's frame at that instant, that are seen at `pixels`. Zero where that cannot be told, or
// is more than the width of the image. All spans have one size.
void scan_offsets(const TrackingRig& rig, int camera, std::span<const Eigen::Vector3d> points_in_rig,
                  const RigMotion& motion, std::span<const Eigen::Vector2d> pixels,
                  std::span<Eigen::Vector2f> offsets);

// The same for a point of which it is not known at which pixel it is seen, to a hundredth of a pixel, but
// where it would be seen at the instant.
Eigen::Vector2f predict_scan_offset(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                                    const RigMotion& motion, const Eigen::Vector2d& at_instant);

// Pixels per second by which a point, in the rig's frame at the instant, moves in the image some time after
// it. Zero where it is not seen then.
Eigen::Vector2d image_velocity(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                               const RigMotion& motion, double seconds);

}  // namespace raysfm
