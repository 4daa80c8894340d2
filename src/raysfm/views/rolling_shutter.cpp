#include "raysfm/views/rolling_shutter.h"

#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

// Pixel of a point that is seen some time after the instant.
bool find_after(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                const Velocity& velocity, double seconds, Eigen::Vector2d* pixel) {
  const Rigid3 later_from_instant = retract(Rigid3{}, seconds * velocity);
  return rig.find(camera, rig.cam_from_rig(camera) * (later_from_instant * point_in_rig), pixel);
}

}  // namespace

Velocity velocity_at(const TimedPose& pose, std::span<const TimedPose> others) {
  Velocity velocity = Velocity::Zero();
  const Rigid3 world_from_rig = pose.rig_from_world.inverse();
  for (size_t i = 0; i < others.size(); ++i) {
    const double t = others[i].time - pose.time;
    double weight = 1 / t;  // derivative at 0 of Lagrange's polynomial that is 1 at t, 0 at 0 and the others
    for (size_t k = 0; k < others.size(); ++k) {
      const double other = others[k].time - pose.time;
      if (k != i) weight *= other / (other - t);
    }
    const Rigid3 motion = others[i].rig_from_world * world_from_rig;
    velocity.head<3>() += weight * motion.translation;
    velocity.tail<3>() += weight * log_so3(motion.rotation);
  }
  return velocity;
}

Eigen::Vector2f scan_offset(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                            const Velocity& velocity, const Eigen::Vector2d& pixel) {
  const double seconds = rig.camera(camera).exposed_after(pixel);
  Eigen::Vector2d at_instant, seen;
  if (seconds == 0 || !find_after(rig, camera, point_in_rig, velocity, 0, &at_instant) ||
      !find_after(rig, camera, point_in_rig, velocity, seconds, &seen)) {
    return Eigen::Vector2f::Zero();
  }
  return (seen - at_instant).cast<float>();
}

Eigen::Vector2f predict_scan_offset(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                                    const Velocity& velocity) {
  constexpr int kSteps = 3;  // each leaves of the error the part of the image that passes during a readout
  Eigen::Vector2d at_instant;
  if (!find_after(rig, camera, point_in_rig, velocity, 0, &at_instant)) return Eigen::Vector2f::Zero();
  Eigen::Vector2d seen = at_instant;
  for (int i = 0; i < kSteps; ++i) {
    const double seconds = rig.camera(camera).exposed_after(seen);
    if (!find_after(rig, camera, point_in_rig, velocity, seconds, &seen)) return Eigen::Vector2f::Zero();
  }
  return (seen - at_instant).cast<float>();
}

Eigen::Vector2d image_velocity(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                               const Velocity& velocity) {
  constexpr double kStep = 1e-3;  // seconds
  Eigen::Vector2d before, after;
  if (!find_after(rig, camera, point_in_rig, velocity, -kStep, &before) ||
      !find_after(rig, camera, point_in_rig, velocity, kStep, &after)) {
    return Eigen::Vector2d::Zero();
  }
  return (after - before) / (2 * kStep);
}

}  // namespace raysfm
