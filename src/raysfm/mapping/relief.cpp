#include "raysfm/mapping/relief.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace raysfm {

using Eigen::Quaterniond;
using Eigen::Vector3d;

namespace {

// The rotation by which a camera looks at what it sees in a direction.
Quaterniond facing(const Vector3d& direction) {
  return Quaterniond::FromTwoVectors(direction, Vector3d::UnitZ());
}

// The rotation as seen in a mirror that lies across the line of sight.
Quaterniond mirrored(const Quaterniond& q) {
  return {q.w(), -q.x(), -q.y(), q.z()};
}

}  // namespace

void reverse_relief(std::span<Rigid3> cam_from_world, std::span<Vector3d> points) {
  constexpr double kFarthest = 10;  // times the mean distance, by inverse distances
  const Rigid3 first = cam_from_world[0], world_from_first = first.inverse();
  Vector3d direction = Vector3d::Zero();
  double nearness = 0;
  for (const Vector3d& point : points) {
    const Vector3d seen = first * point;
    direction += seen.normalized();
    nearness += 1 / seen.norm();
  }
  nearness /= static_cast<double>(points.size());
  for (Vector3d& point : points) {
    const Vector3d seen = first * point;
    const double reversed = std::max(2 * nearness - 1 / seen.norm(), nearness / kFarthest);
    point = world_from_first * (seen.normalized() / reversed);
  }
  // Each camera keeps the centre of all where it sees it, and goes round it the other way.
  const Vector3d centre = world_from_first * (direction.normalized() / nearness);
  const Quaterniond first_facing = facing(first * centre) * first.rotation;
  for (Rigid3& pose : cam_from_world) {
    const Vector3d seen = pose * centre;
    const Quaterniond face = facing(seen);
    const Quaterniond round = face * pose.rotation * first_facing.conjugate();
    pose.rotation = (face.conjugate() * mirrored(round) * first_facing).normalized();
    pose.translation = seen - pose.rotation * centre;
  }
}

}  // namespace raysfm
