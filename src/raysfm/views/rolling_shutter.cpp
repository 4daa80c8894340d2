#include "raysfm/views/rolling_shutter.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "raysfm/geometry/rotation.h"
#include "raysfm/residuals/block_residual.h"

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

Eigen::Vector3d moved(const Eigen::Vector3d& point_in_rig, const RigMotion& motion, double seconds) {
  const RigMotion::Tangent way = motion.after(seconds);
  return rotate(way.tail<3>(), point_in_rig) + way.head<3>();
}

// Pixel of a point that is seen some time after the instant.
bool find_after(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                const RigMotion& motion, double seconds, Eigen::Vector2d* pixel) {
  return rig.find(camera, rig.cam_from_rig(camera) * moved(point_in_rig, motion, seconds), pixel);
}

// A point next to the plane of the camera, where one is that is no point, may be seen anywhere.
Eigen::Vector2f within_image(const Camera& camera, const Eigen::Vector2d& offset) {
  return offset.norm() < camera.width ? Eigen::Vector2f(offset.cast<float>()) : Eigen::Vector2f::Zero();
}

// Of a camera that projects: residuals of pixels at the origin are where points are seen.
void offsets_by_eights(const Camera& camera, std::span<const Eigen::Vector3d> points_in_rig,
                       const RigMotion& motion, std::span<const Eigen::Vector2d> pixels,
                       std::span<Eigen::Vector2f> offsets) {
  static constexpr double kOrigin[kBlockLanes] = {};
  with_pixel_residual(camera, kOrigin, kOrigin, [&](const BlockResidual& projection) {
    ResidualBlock at_instant, seen;
    for (size_t begin = 0; begin < offsets.size(); begin += kBlockLanes) {
      const size_t count = std::min<size_t>(kBlockLanes, offsets.size() - begin);
      for (size_t k = 0; k < kBlockLanes; ++k) {
        const size_t i = begin + std::min(k, count - 1);
        const Eigen::Vector3d later = moved(points_in_rig[i], motion, camera.exposed_after(pixels[i]));
        for (int c = 0; c < 3; ++c) at_instant.x[c][k] = points_in_rig[i][c], seen.x[c][k] = later[c];
      }
      projection.evaluate(0, false, &at_instant);
      projection.evaluate(0, false, &seen);
      for (size_t k = 0; k < count; ++k) {
        offsets[begin + k].setZero();
        if (!std::isfinite(at_instant.squared[k]) || !std::isfinite(seen.squared[k])) continue;
        const Eigen::Vector2d offset(seen.residual[0][k] - at_instant.residual[0][k],
                                     seen.residual[1][k] - at_instant.residual[1][k]);
        offsets[begin + k] = within_image(camera, offset);
      }
    }
  });
}

}  // namespace

RigMotion motion_at(const TimedPose& pose, std::span<const TimedPose> others) {
  RigMotion motion;
  const Rigid3 world_from_rig = pose.rig_from_world.inverse();
  // Mean velocities to the farthest poses before and after.
  RigMotion::Tangent mean_before = RigMotion::Tangent::Zero(), mean_after = mean_before;
  double before = 0, after = 0;
  for (size_t i = 0; i < others.size(); ++i) {
    const double t = others[i].time - pose.time;
    double weight = 1 / t;  // derivative at 0 of Lagrange's polynomial that is 1 at t, 0 at 0 and the others
    for (size_t k = 0; k < others.size(); ++k) {
      const double other = others[k].time - pose.time;
      if (k != i) weight *= other / (other - t);
    }
    const Rigid3 relative = others[i].rig_from_world * world_from_rig;
    RigMotion::Tangent way;
    way << relative.translation, log_so3(relative.rotation);
    motion.velocity += weight * way;
    if (t < before) before = t, mean_before = way / t;
    if (t > after) after = t, mean_after = way / t;
  }
  if (before < 0 && after > 0) motion.acceleration = 2 / (after - before) * (mean_after - mean_before);
  return motion;
}

void scan_offsets(const TrackingRig& rig, int camera, std::span<const Eigen::Vector3d> points_in_rig,
                  const RigMotion& motion, std::span<const Eigen::Vector2d> pixels,
                  std::span<Eigen::Vector2f> offsets) {
  if (rig.camera(camera).can_project()) {
    offsets_by_eights(rig.camera(camera), points_in_rig, motion, pixels, offsets);
    return;
  }
  for (size_t i = 0; i < offsets.size(); ++i) {
    const double seconds = rig.camera(camera).exposed_after(pixels[i]);
    Eigen::Vector2d at_instant, seen;
    const bool is_told = find_after(rig, camera, points_in_rig[i], motion, 0, &at_instant) &&
                         find_after(rig, camera, points_in_rig[i], motion, seconds, &seen);
    offsets[i] = is_told ? within_image(rig.camera(camera), seen - at_instant) : Eigen::Vector2f::Zero();
  }
}

Eigen::Vector2f predict_scan_offset(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                                    const RigMotion& motion, const Eigen::Vector2d& at_instant) {
  constexpr int kSteps = 3;  // each leaves of the error the part of the image that passes during a readout
  constexpr double kNear = 0.05;  // pixels: the step after one that is shorter leaves nothing
  Eigen::Vector2d seen = at_instant;
  for (int i = 0; i < kSteps; ++i) {
    const Eigen::Vector2d before = seen;
    const double seconds = rig.camera(camera).exposed_after(seen);
    if (!find_after(rig, camera, point_in_rig, motion, seconds, &seen)) return Eigen::Vector2f::Zero();
    if ((seen - before).squaredNorm() < kNear * kNear) break;
  }
  return within_image(rig.camera(camera), seen - at_instant);
}

Eigen::Vector2d image_velocity(const TrackingRig& rig, int camera, const Eigen::Vector3d& point_in_rig,
                               const RigMotion& motion, double seconds) {
  const Rigid3& cam_from_rig = rig.cam_from_rig(camera);
  const Eigen::Vector3d then = moved(point_in_rig, motion, seconds);
  const RigMotion::Tangent velocity = motion.velocity_after(seconds);
  const Eigen::Vector3d by_second = velocity.tail<3>().cross(then) + velocity.head<3>();
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 3> jacobian;
  if (!rig.find(camera, cam_from_rig * then, &pixel, &jacobian)) return Eigen::Vector2d::Zero();
  return jacobian * (cam_from_rig.rotation * by_second);
}

}  // namespace raysfm
