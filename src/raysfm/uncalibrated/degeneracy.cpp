#include "raysfm/uncalibrated/degeneracy.h"

#include <Eigen/Dense>
#include <algorithm>
#include <vector>

namespace raysfm {
namespace {

constexpr double kMaxFocalSigma = 0.3;
constexpr double kSmallAngle = 0.02;  // radians
constexpr double kSmallShare = 0.01;  // of the extent of the scene

bool lenses_are_known(std::span<const Lens> lenses, std::span<const LensVector> sigma) {
  const auto known = [&](size_t j) { return sigma[j][0] < kMaxFocalSigma * lenses[j].fx; };
  size_t count = 0;
  for (size_t j = 0; j < lenses.size(); ++j) count += known(j);
  return 2 * count > lenses.size();
}

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

// Root mean square distance of the optical axes from the point nearest to all of them.
double miss_of_axes(std::span<const Rigid3> poses) {
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
  double sum = 0;
  for (size_t j = 0; j < poses.size(); ++j) sum += (across[j] * (nearest - centres[j])).squaredNorm();
  return std::sqrt(sum / double(poses.size()));
}

}  // namespace

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
  if (largest_rotation(poses) < kSmallAngle) return "pure translation";
  if (largest_angle_of_axes(poses) < kSmallAngle) return "parallel optical axes";
  if (lenses_are_known(lenses, sigmas)) return "";
  const Eigen::Vector3d scene_extents = extents(points);
  const double extent = scene_extents[2];
  if (extents(centres)[2] < kSmallShare * extent) return "pure rotation";
  if (scene_extents[0] < kSmallShare * extent) return "planar scene";
  if (miss_of_axes(poses) < kSmallShare * extent) return "optical axes through one point";
  return "undetermined";
}

}  // namespace raysfm
