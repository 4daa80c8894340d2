#include "raysfm/views/rolling_shutter.h"

#include <Eigen/Geometry>
#include <cmath>

#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

// exp_so3(omega) * x: cheaper than the quaternion where it turns one vector only.
Eigen::Vector3d rotate(const Eigen::Vector3d& omega, const Eigen::Vector3d& x) {
  constexpr double kSmall = 0.01;  // below, the series are exact to 1e-13
  const double a = omega.squaredNorm();
  double by_sine, by_cosine;  // sin(angle) / angle, (1 - cos(angle)) / angle^2
  if (a < kSmall) {
    by_sine = 1 - a / 6 * (1 - a / 20 * (1 - a / 42));
    by_cosine = 0.5 - a / 24 * (1 - a / 30 * (1 - a / 56));
  } else {
    const double angle = std::sqrt(a);
    by_sine = std::sin(angle) / angle;
    by_cosine = (1 - std::cos(angle)) / a;
  }
  const Eigen::Vector3d across = omega.cross(x);
  return x + by_sine * across + by_cosine * omega.cross(across);
}

// Pixel of a point that is seen some time after the instant.
bool find_after(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                const Velocity& velocity, double seconds, Eigen::Vector2d* pixel) {
  const Eigen::Vector3d later =
      rotate(seconds * velocity.tail<3>(), point_in_rig) + seconds * velocity.head<3>();
  return rig.find(camera, rig.cam_from_rig(camera) * later, pixel);
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
                                    const Velocity& velocity, const Eigen::Vector2d& at_instant) {
  constexpr int kSteps = 3;  // each leaves of the error the part of the image that passes during a readout
  constexpr double kNear = 0.05;  // pixels: the step after one that is shorter leaves nothing
  Eigen::Vector2d seen = at_instant;
  for (int i = 0; i < kSteps; ++i) {
    const Eigen::Vector2d before = seen;
    const double seconds = rig.camera(camera).exposed_after(seen);
    if (!find_after(rig, camera, point_in_rig, velocity, seconds, &seen)) return Eigen::Vector2f::Zero();
    if ((seen - before).squaredNorm() < kNear * kNear) break;
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
