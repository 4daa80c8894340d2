#include "raysfm/projective/homography_cause.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

// How far from a rotation a homography is, with the focal lengths that make it most like one.
struct Likeness {
  double excess = INFINITY;  // of the largest over the smallest singular value
  double angle = 0;          // radians
};

Likeness likeness(const Eigen::Matrix3d& homography, double log_focal_a, double log_focal_b) {
  const double of_a = std::exp(log_focal_a), of_b = std::exp(log_focal_b);
  const Eigen::Matrix3d m = Eigen::Vector3d(1 / of_b, 1 / of_b, 1).asDiagonal() * homography *
                            Eigen::Vector3d(of_a, of_a, 1).asDiagonal();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(m.transpose() * m, Eigen::EigenvaluesOnly);
  const double excess = std::sqrt(eigen.eigenvalues()[2] / std::max(1e-12, eigen.eigenvalues()[0])) - 1;
  // Of a rotation times a scale the trace gives the angle.
  const double scale = std::cbrt(m.determinant());
  return {excess, std::acos(std::clamp(0.5 * (m.trace() / scale - 1), -1.0, 1.0))};
}

// Over the focal lengths of both images: on a grid, then ever closer about the best.
Likeness likeness_to_rotation(const Eigen::Matrix3d& homography) {
  constexpr int kSteps = 9, kRefinements = 9;
  const double least = std::log(0.2), most = std::log(10.0);
  double step = (most - least) / (kSteps - 1), best_a = least, best_b = least;
  Likeness best;
  const auto look = [&](double a, double b) {
    const Likeness here = likeness(homography, std::clamp(a, least, most), std::clamp(b, least, most));
    if (here.excess < best.excess) best = here, best_a = a, best_b = b;
  };
  for (int i = 0; i < kSteps * kSteps; ++i) look(least + step * (i % kSteps), least + step * (i / kSteps));
  for (int round = 0; round < kRefinements; ++round, step *= 0.6) {
    const double a = best_a, b = best_b;
    for (int i = 0; i < 25; ++i) look(a + 0.5 * step * (i % 5 - 2), b + 0.5 * step * (i / 5 - 2));
  }
  return best;
}

}  // namespace

HomographyCause homography_cause(std::span<const Eigen::Matrix3d> homographies) {
  constexpr double kRotation = 0.04, kPlane = 0.1;  // of the excess
  constexpr double kSmallAngle = 0.02;              // radians
  double excess = 0, angle = 0;
  for (const Eigen::Matrix3d& homography : homographies) {
    const Likeness likeness = likeness_to_rotation(homography);
    excess = std::max(excess, likeness.excess);
    angle = std::max(angle, likeness.angle);
  }
  if (excess > kPlane) return HomographyCause::kPlane;
  if (excess > kRotation || homographies.empty()) return HomographyCause::kUnclear;
  return angle < kSmallAngle ? HomographyCause::kStill : HomographyCause::kRotation;
}

}  // namespace raysfm
