#include "raysfm/projective/absolute_quadric.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>

#include "raysfm/core/median.h"

namespace raysfm {
namespace {

using Vector10d = Eigen::Matrix<double, 10, 1>;
using Matrix10d = Eigen::Matrix<double, 10, 10>;

// Coefficients of (P Q P^T)_rc on the ten numbers of Q's upper triangle by rows.
Vector10d quadric_row(const Matrix34d& p, int r, int c) {
  Vector10d row;
  int k = 0;
  for (int i = 0; i < 4; ++i) {
    for (int j = i; j < 4; ++j) row[k++] = p(r, i) * p(c, j) + (i == j ? 0 : p(r, j) * p(c, i));
  }
  return row;
}

Eigen::Matrix4d quadric_from(const Vector10d& numbers) {
  Eigen::Matrix4d q;
  int k = 0;
  for (int i = 0; i < 4; ++i) {
    for (int j = i; j < 4; ++j) q(i, j) = q(j, i) = numbers[k++];
  }
  return q;
}

// Least squares over the conditions of the class comment, each divided by its standard deviation and, from
// the second round, by the last (P Q P^T)_33.
Vector10d linear_quadric(std::span<const Matrix34d> views, double log_focal_sigma) {
  constexpr double kSkew = 0.01, kAspect = 0.2, kPrincipalPoint = 0.1;
  Vector10d numbers = Vector10d::Zero();
  for (int round = 0; round < 3; ++round) {
    Matrix10d normal = Matrix10d::Zero();
    for (const Matrix34d& p : views) {
      const Vector10d r33 = quadric_row(p, 2, 2);
      const double last = round == 0 ? p.row(2).squaredNorm() : std::abs(r33.dot(numbers));
      const double unit = 1 / std::max(last, 1e-9 * p.squaredNorm());
      const auto add = [&](const Vector10d& row, double sigma) {
        normal.noalias() += (unit / sigma) * (unit / sigma) * row * row.transpose();
      };
      const Vector10d r11 = quadric_row(p, 0, 0), r22 = quadric_row(p, 1, 1);
      add(quadric_row(p, 0, 1), kSkew);
      add(quadric_row(p, 0, 2), kPrincipalPoint);
      add(quadric_row(p, 1, 2), kPrincipalPoint);
      add(r11 - r22, kAspect);
      add(r11 - r33, 2 * log_focal_sigma);
      add(r22 - r33, 2 * log_focal_sigma);
    }
    numbers = Eigen::SelfAdjointEigenSolver<Matrix10d>(normal).eigenvectors().col(0);
  }
  return numbers;
}

Eigen::Matrix3d scaling(double u, double w) {
  return Eigen::Vector3d(u, u, w).asDiagonal();
}

// Squared deviation of the lenses from what is expected of them, mean over the views.
double lens_cost(std::span<const Lens> lenses, bool equal) {
  constexpr double kSkew = 0.05, kAspect = 0.05, kPrincipalPoint = 0.1;
  double mean_log = 0, sum = 0;
  for (const Lens& k : lenses) mean_log += std::log(k.fx) / lenses.size();
  for (const Lens& k : lenses) {
    const double change = std::log(k.fx) - mean_log;
    sum += std::pow(k.skew / k.fx / kSkew, 2) + std::pow((k.fy / k.fx - 1) / kAspect, 2);
    sum += std::pow(std::hypot(k.cx, k.cy) / kPrincipalPoint, 2);
    sum += std::pow(change / (equal ? 0.05 : 0.5), 2);
  }
  return sum / lenses.size();
}

struct Candidate {
  double cost = 0;
  UncalibratedScene scene;
};

void bring_to_unit_scale(UncalibratedScene* scene) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& x : scene->points) mean += x / scene->points.size();
  std::vector<double> distances;
  for (const Eigen::Vector3d& x : scene->points) distances.push_back((x - mean).norm());
  const double middle = median_of(&distances);
  const double scale = middle > 0 ? 1 / middle : 1;
  for (Eigen::Vector3d& x : scene->points) x *= scale;
  for (Rigid3& pose : scene->cam_from_world) pose.translation *= scale;
}

}  // namespace

std::optional<Eigen::Matrix4d> metric_upgrade(std::span<const Matrix34d> views, double focal,
                                              double log_focal_sigma) {
  std::vector<Matrix34d> scaled;
  for (const Matrix34d& view : views) scaled.push_back((scaling(1 / focal, 1) * view).normalized());
  Eigen::Matrix4d q = quadric_from(linear_quadric(scaled, log_focal_sigma));
  double sign = 0;
  for (const Matrix34d& p : scaled) sign += (p * q * p.transpose())(2, 2) / p.row(2).squaredNorm();
  if (sign < 0) q = -q;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(q);
  const Eigen::Vector4d& values = eigen.eigenvalues();  // ascending
  if (!(values[1] > 1e-12 * values[3]) || !values.allFinite()) return std::nullopt;
  Eigen::Matrix4d upgrade;
  for (int k = 0; k < 3; ++k) upgrade.col(k) = std::sqrt(values[3 - k]) * eigen.eigenvectors().col(3 - k);
  upgrade.col(3) = eigen.eigenvectors().col(0);
  return upgrade;
}

bool decompose_view(const Matrix34d& view, Lens* lens, Rigid3* cam_from_world) {
  Matrix34d p = view / view.leftCols<3>().norm();
  if (p.leftCols<3>().determinant() < 0) p = -p;
  const Eigen::Matrix3d m = p.leftCols<3>(), s = m * m.transpose();
  if (!(s(2, 2) > 1e-16)) return false;
  // K K^T by its upper triangular factor, scaled to K_33 = 1.
  const Eigen::Matrix3d w = s / s(2, 2);
  const double d2 = w(1, 1) - w(1, 2) * w(1, 2);
  if (!(d2 > 0)) return false;
  const double d = std::sqrt(d2), b = (w(0, 1) - w(0, 2) * w(1, 2)) / d;
  const double a2 = w(0, 0) - w(0, 2) * w(0, 2) - b * b;
  if (!(a2 > 0)) return false;
  *lens = {std::sqrt(a2), d, w(0, 2), w(1, 2), b};
  const Matrix34d rt = lens->matrix().inverse() * p / std::sqrt(s(2, 2));
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(rt.leftCols<3>(), Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d rotation = svd.matrixU() * svd.matrixV().transpose();
  *cam_from_world = {Eigen::Quaterniond(rotation).normalized(), rt.col(3)};
  return lens->vector().allFinite() && rt.allFinite() && rotation.determinant() > 0;
}

std::optional<UncalibratedScene> upgraded_scene(const ProjectiveScene& scene, const Eigen::Matrix4d& upgrade,
                                                const ObservationIndex& index, double* in_front) {
  const Eigen::FullPivLU<Eigen::Matrix4d> lu(upgrade);
  if (!lu.isInvertible()) return std::nullopt;
  UncalibratedScene metric;
  for (const Matrix34d& view : scene.views) {
    metric.lenses.emplace_back();
    metric.cam_from_world.emplace_back();
    if (!decompose_view(view * upgrade, &metric.lenses.back(), &metric.cam_from_world.back()))
      return std::nullopt;
  }
  for (const Eigen::Vector4d& point : scene.points) {
    const Eigen::Vector4d x = lu.solve(point);
    const double w = std::abs(x.w()) > 1e-12 * x.norm() ? x.w() : std::copysign(1e-12 * x.norm(), x.w());
    metric.points.push_back(x.head<3>() / w);
  }
  int front = 0;
  for (int j = 0; j < index.image_count(); ++j) {
    for (int o = index.image_begin[j]; o < index.image_begin[j + 1]; ++o) {
      front += (metric.cam_from_world[j] * metric.points[index.point_of[o]]).z() > 0;
    }
  }
  if (2 * front < index.size()) {
    // The mirrored scene has the same images.
    for (Rigid3& pose : metric.cam_from_world) pose.translation = -pose.translation;
    for (Eigen::Vector3d& x : metric.points) x = -x;
    front = index.size() - front;
  }
  *in_front = static_cast<double>(front) / index.size();
  bring_to_unit_scale(&metric);
  return metric;
}

std::vector<UncalibratedScene> metric_candidates(const ProjectiveScene& scene, const ObservationIndex& index,
                                                 bool equal_lenses, int count) {
  constexpr std::array kFocals = {0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 6.0};
  constexpr std::array kSpreads = {4.5, 1.0, 0.2, 0.05};  // the first is Pollefeys's; of log focal length
  constexpr double kMinInFront = 0.9, kAlike = 0.05;
  std::vector<Candidate> candidates;
  for (const double spread : kSpreads) {
    for (const double focal : kFocals) {
      const auto upgrade = metric_upgrade(scene.views, focal, spread);
      double in_front = 0;
      if (!upgrade) continue;
      auto metric = upgraded_scene(scene, *upgrade, index, &in_front);
      if (!metric || in_front < kMinInFront) continue;
      candidates.push_back(
          {lens_cost(metric->lenses, equal_lenses) + 10 * (1 - in_front), std::move(*metric)});
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
  std::vector<UncalibratedScene> best;
  for (Candidate& candidate : candidates) {
    const auto alike = [&](const UncalibratedScene& other) {
      return std::abs(std::log(candidate.scene.lenses[0].fx / other.lenses[0].fx)) < kAlike;
    };
    if (std::any_of(best.begin(), best.end(), alike)) continue;
    best.push_back(std::move(candidate.scene));
    if (static_cast<int>(best.size()) == count) break;
  }
  return best;
}

}  // namespace raysfm
