#include "raysfm/mapping/planar_twin.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double kFarthestOfPlane = 10;  // times the mean distance, by inverse distances

// n of the plane n x = 1 that most of the points are on: by the parts of their distances that they are off.
Vector3d plane_of(std::span<const Vector3d> points) {
  constexpr int kReweightings = 10;
  constexpr double kOff = 0.02;
  Vector3d plane = Vector3d::Zero();
  for (int i = 0; i < kReweightings; ++i) {
    Matrix3d a = Matrix3d::Zero();
    Vector3d b = Vector3d::Zero();
    for (const Vector3d& x : points) {
      const double weight = i == 0 ? 1 : 1 / (kOff + std::abs(plane.dot(x) - 1));
      const Vector3d direction = x.normalized();
      const double nearness = 1 / x.norm();
      a += weight * x.squaredNorm() * direction * direction.transpose();
      b += weight * x.squaredNorm() * nearness * direction;
    }
    plane = a.ldlt().solve(b);
  }
  return plane;
}

// A motion and the plane n x = 1, both in the frame that it is from.
struct PlaneMotion {
  Rigid3 pose;
  Vector3d plane;
};

// The other one of the same homography G = R + t n': with a = R't and b = a + |a|^2 n / 2, G'G - I is
// b n' + n b', in which b and n may change places. `ahead`: a direction in which the plane is seen.
PlaneMotion twin_of(const PlaneMotion& motion, const Vector3d& ahead) {
  const Matrix3d rotation = motion.pose.rotation.toRotationMatrix();
  const Vector3d& n = motion.plane;
  const Vector3d a = rotation.transpose() * motion.pose.translation;
  const Vector3d b = a + 0.5 * a.squaredNorm() * n;
  // Of all lengths the one that leaves the plane as far away.
  const double length = n.dot(ahead) / b.dot(ahead);
  const Vector3d other = length * b;
  const double squared = a.squaredNorm() * n.squaredNorm() / other.squaredNorm();
  const Vector3d step = n / length - 0.5 * squared * other;
  const Matrix3d homography = rotation * (Matrix3d::Identity() + a * n.transpose());
  const Matrix3d turn =
      homography * (Matrix3d::Identity() - step * other.transpose() / (1 + step.dot(other)));
  const Eigen::Quaterniond turned = Eigen::Quaterniond(turn).normalized();
  return {{turned, turned * step}, other};
}

}  // namespace

bool take_planar_twin(std::span<Rigid3> cam_from_world, std::span<Vector3d> points) {
  const Rigid3 first = cam_from_world[0], world_from_first = first.inverse();
  std::vector<Vector3d> seen;
  Vector3d ahead = Vector3d::Zero();
  for (const Vector3d& point : points) {
    seen.push_back(first * point);
    ahead += seen.back().normalized();
  }
  ahead.normalize();
  const Vector3d plane = plane_of(seen);
  const auto motion_of = [&](const Rigid3& pose) { return PlaneMotion{pose * world_from_first, plane}; };
  const auto distance = [&](const Rigid3& pose) { return motion_of(pose).pose.translation.norm(); };
  const Rigid3& farthest = *std::ranges::max_element(cam_from_world, {}, distance);
  constexpr double kLeastMotion = 1e-3;  // of the distance to the plane
  if (!(distance(farthest) * plane.norm() > kLeastMotion)) return false;
  const Vector3d other = twin_of(motion_of(farthest), ahead).plane;
  const auto is_ahead = [&](const Vector3d& x) { return other.dot(x) > 0; };
  if (2 * static_cast<size_t>(std::ranges::count_if(seen, is_ahead)) < points.size()) return false;

  for (size_t i = 0; i < points.size(); ++i) {
    const Vector3d direction = seen[i].normalized();
    const double nearness = std::max(other.dot(direction), other.dot(ahead) / kFarthestOfPlane);
    points[i] = world_from_first * (direction / nearness);
  }
  for (Rigid3& pose : cam_from_world) {
    if (!(distance(pose) * plane.norm() > kLeastMotion)) continue;
    pose = twin_of(motion_of(pose), ahead).pose * first;
  }
  return true;
}

}  // namespace raysfm
