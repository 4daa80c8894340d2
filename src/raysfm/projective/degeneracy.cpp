#include "raysfm/projective/degeneracy.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "raysfm/core/median.h"

namespace raysfm {
namespace {

constexpr double kMaxFocalSigma = 0.3;
constexpr double kSmallAngle = 0.02;  // radians
constexpr double kSmallShare = 0.01;  // of the extent of the scene

constexpr double kMinParallax = 0.01;  // radians

// Square roots of the ascending eigenvalues of the covariance.
Eigen::Vector3d extents(std::span<const Eigen::Vector3d> points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& x : points) mean += x / double(points.size());
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& x : points)
    covariance += (x - mean) * (x - mean).transpose() / double(points.size());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance);
  return eigen.eigenvalues().cwiseMax(0).cwiseSqrt();
}

// The median over the points of the largest angle between the rays of two cameras.
double median_parallax(std::span<const Eigen::Vector3d> points, std::span<const Eigen::Vector3d> centres) {
  std::vector<double> angles;
  for (const Eigen::Vector3d& x : points) {
    double largest = 0;
    for (const Eigen::Vector3d& c : centres) {
      const Eigen::Vector3d a = (x - c).normalized(), b = (x - centres[0]).normalized();
      largest = std::max(largest, std::atan2(a.cross(b).norm(), a.dot(b)));
    }
    angles.push_back(largest);
  }
  return median_of(&angles);
}

double largest_rotation(std::span<const Rigid3> poses) {
  double largest = 0;
  for (const Rigid3& pose : poses) {
    largest = std::max(largest, rotation_angle(pose.rotation * poses[0].rotation.conjugate()));
  }
  return largest;
}

double largest_angle_of_axes(std::span<const Rigid3> poses) {
  double largest = 0;
  const auto axis = [](const Rigid3& pose) -> Eigen::Vector3d {
    return pose.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  };
  for (const Rigid3& pose : poses) {
    largest = std::max(largest,
                       std::atan2(axis(pose).cross(axis(poses[0])).norm(), axis(pose).dot(axis(poses[0]))));
  }
  return largest;
}

// Whether the optical axes pass through one point, up to a share of the extent of the scene and to what the
// standard deviations of the principal points let them turn.
bool axes_meet(std::span<const Rigid3> poses, std::span<const Lens> lenses, std::span<const LensVector> sigma,
               double extent) {
  constexpr double kMaxTurn = 0.1;  // radians
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  std::vector<Eigen::Matrix3d> across;
  std::vector<Eigen::Vector3d> centres;
  for (const Rigid3& pose : poses) {
    const Eigen::Vector3d axis = pose.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    across.push_back(Eigen::Matrix3d::Identity() - axis * axis.transpose());
    centres.push_back(pose.inverse().translation);
    normal += across.back();
    right += across.back() * centres.back();
  }
  const Eigen::Vector3d nearest = normal.ldlt().solve(right);
  double miss = 0, allowed = 0;
  for (size_t j = 0; j < poses.size(); ++j) {
    const double turn = std::hypot(sigma[j][2], sigma[j][3]) / lenses[j].fx;
    const double far = std::min(turn, kMaxTurn) * (nearest - centres[j]).norm();
    miss += (across[j] * (nearest - centres[j])).squaredNorm();
    allowed += far * far + kSmallShare * kSmallShare * extent * extent;
  }
  return miss < allowed;
}

}  // namespace

bool focal_lengths_are_known(std::span<const Lens> lenses, std::span<const LensVector> sigma) {
  size_t count = 0;
  for (size_t j = 0; j < lenses.size(); ++j) count += sigma[j][0] < kMaxFocalSigma * lenses[j].fx;
  return 2 * count > lenses.size();
}

std::string name_degeneracy(const UncalibratedScene& scene, std::span<const uint8_t> image_posed,
                            std::span<const uint8_t> point_placed, std::span<const LensVector> sigma) {
  std::vector<Rigid3> poses;
  std::vector<Lens> lenses;
  std::vector<LensVector> sigmas;
  std::vector<Eigen::Vector3d> points, centres;
  for (size_t j = 0; j < image_posed.size(); ++j) {
    if (!image_posed[j]) continue;
    poses.push_back(scene.cam_from_world[j]);
    centres.push_back(poses.back().inverse().translation);
    lenses.push_back(scene.lenses[j]);
    sigmas.push_back(sigma[j]);
  }
  for (size_t i = 0; i < point_placed.size(); ++i) {
    if (point_placed[i]) points.push_back(scene.points[i]);
  }
  if (poses.empty() || points.empty()) return "";
  // Critical whatever the standard deviations say: where the adjustment ended they may be small by chance.
  if (median_parallax(points, centres) < kMinParallax) return "pure rotation";
  if (largest_rotation(poses) < kSmallAngle) return "pure translation";
  if (largest_angle_of_axes(poses) < kSmallAngle) return "parallel optical axes";
  if (focal_lengths_are_known(lenses, sigmas)) return "";
  const Eigen::Vector3d scene_extents = extents(points);
  const double extent = scene_extents[2];
  if (scene_extents[0] < kSmallShare * extent) return "planar scene";
  if (axes_meet(poses, lenses, sigmas, extent)) return "optical axes through one point";
  return "undetermined";
}

}  // namespace raysfm
