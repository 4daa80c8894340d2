#include "raysfm/camera/pixel_finder.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace raysfm {
namespace {

// The plane in which ray and point are compared: gnomonic coordinates about the direction in which the point
// is seen from the first ray's origin.
struct TangentPlane {
  Eigen::Vector3d axis;
  Eigen::Matrix<double, 2, 3> tangents;

  explicit TangentPlane(const Eigen::Vector3d& unit_axis) : axis(unit_axis) {
    tangents.row(0) = axis.unitOrthogonal();
    tangents.row(1) = axis.cross(tangents.row(0).transpose());
  }

  // False for directions at more than a right angle to the axis.
  bool coordinates(const Eigen::Vector3d& v, Eigen::Vector2d* c) const {
    const double depth = axis.dot(v);
    *c = tangents * v / depth;
    return depth > 1e-3 * v.norm();
  }
};

// f(pixel) = coordinates of the point as the pixel's origin sees it, less those of the pixel's ray. Zero
// where the camera sees the point.
struct Miss {
  const Camera& camera;
  const Eigen::Vector3d& point;
  TangentPlane plane;

  bool operator()(const Eigen::Vector2d& pixel, Eigen::Vector2d* f) const {
    Ray ray;
    Eigen::Vector2d seen, wanted;
    if (!camera.ray(pixel, &ray) || !plane.coordinates(ray.direction, &seen) ||
        !plane.coordinates(point - ray.origin, &wanted)) {
      return false;
    }
    *f = wanted - seen;
    return true;
  }

  // df / dpixel by differences of `h` pixels, to one side at the border of what the camera sees.
  bool jacobian(const Eigen::Vector2d& pixel, const Eigen::Vector2d& f, double h, Eigen::Matrix2d* j) const {
    for (int i = 0; i < 2; ++i) {
      const Eigen::Vector2d step = h * Eigen::Vector2d::Unit(i);
      Eigen::Vector2d plus = f, minus = f;
      const bool has_plus = (*this)(pixel + step, &plus), has_minus = (*this)(pixel - step, &minus);
      if (!has_plus && !has_minus) return false;
      j->col(i) = (plus - minus) / (has_plus && has_minus ? 2 * h : h);
    }
    return true;
  }
};

// Newton's method from `pixel`. Steps are halved until they stay where the camera sees something and bring f
// down; none is longer than `max_step`, and a first one that would be starts too far away. While f falls fast
// the derivative follows by Broyden's updates, else it is computed again.
bool solve(const Miss& miss, double max_step, Eigen::Vector2d* pixel) {
  constexpr int kMaxIterations = 30, kMaxHalvings = 8;
  constexpr double kTolerance = 1e-8, kDifference = 0.25;  // pixels
  constexpr double kFast = 0.1;
  Eigen::Vector2d p = *pixel, f;
  Eigen::Matrix2d j;
  if (!miss(p, &f) || !miss.jacobian(p, f, kDifference, &j)) return false;
  bool fresh = true;
  for (int i = 0; i < kMaxIterations; ++i) {
    Eigen::Vector2d step = -(j.inverse() * f);
    const double length = step.norm();
    if (!std::isfinite(length) || (i == 0 && length > max_step)) return false;
    if (length < kTolerance) return *pixel = p + step, true;
    step *= std::min(1.0, max_step / length);
    Eigen::Vector2d next = p + step, next_f;
    int halvings = 0;
    while (halvings <= kMaxHalvings && (!miss(next, &next_f) || !(next_f.squaredNorm() < f.squaredNorm()))) {
      ++halvings;
      next = p + (step *= 0.5);
    }
    const bool moved = halvings <= kMaxHalvings;
    if (!moved && fresh) return false;
    fresh = !moved || next_f.norm() > kFast * f.norm();
    if (!fresh) j += (next_f - f - j * step) * step.transpose() / step.squaredNorm();
    if (moved) {
      p = next;
      f = next_f;
    }
    if (fresh && !miss.jacobian(p, f, kDifference, &j)) return false;
  }
  return false;
}

}  // namespace

PixelFinder::PixelFinder(const Camera& camera) : camera_(camera), projects_(camera.can_project()) {
  if (projects_) return;
  for (auto* array : {&ox_, &oy_, &oz_, &dx_, &dy_, &dz_}) array->assign(kGrid * kGrid, 0.0f);
  for (int i = 0; i < kGrid * kGrid; ++i) {
    Ray ray;
    if (!camera_.ray(grid_pixel(i), &ray)) ray.direction.setZero();
    ox_[i] = static_cast<float>(ray.origin.x());
    oy_[i] = static_cast<float>(ray.origin.y());
    oz_[i] = static_cast<float>(ray.origin.z());
    dx_[i] = static_cast<float>(ray.direction.x());
    dy_[i] = static_cast<float>(ray.direction.y());
    dz_[i] = static_cast<float>(ray.direction.z());
  }
}

Eigen::Vector2d PixelFinder::grid_pixel(int index) const {
  return {(index % kGrid + 0.5) * camera_.width / kGrid - 0.5,
          (index / kGrid + 0.5) * camera_.height / kGrid - 0.5};
}

bool PixelFinder::find(const Eigen::Vector3d& point_in_cam, Eigen::Vector2d* pixel,
                       Eigen::Matrix<double, 2, 3>* jacobian) const {
  return projects_ ? camera_.project(point_in_cam, pixel, jacobian) : search(point_in_cam, pixel, jacobian);
}

// Squared cosine of the angle between each ray of the grid and the point, negative beyond a right angle.
void PixelFinder::score(const Eigen::Vector3f& point, float* scores) const {
  const float x = point.x(), y = point.y(), z = point.z();
  const float *ox = ox_.data(), *oy = oy_.data(), *oz = oz_.data();
  const float *dx = dx_.data(), *dy = dy_.data(), *dz = dz_.data();
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const float mx = x - ox[i], my = y - oy[i], mz = z - oz[i];
    const float dot = mx * dx[i] + my * dy[i] + mz * dz[i];
    scores[i] = dot * std::abs(dot) / (mx * mx + my * my + mz * mz);
  }
}

bool PixelFinder::search(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                         Eigen::Matrix<double, 2, 3>* jacobian) const {
  constexpr int kAttempts = 3, kTried = 2;  // attempts start more than kTried rays of the grid apart
  constexpr double kFar = 1e6;              // beyond it floats do not tell origins apart
  const double distance = point.norm();
  if (!(distance > 0) || !std::isfinite(distance)) return false;
  std::array<float, kGrid * kGrid> scores;
  score((point * std::min(1.0, kFar / distance)).cast<float>(), scores.data());
  const double max_step = 3.0 * std::max(camera_.width, camera_.height) / kGrid;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    int best = -1;
    float best_score = 0;
    for (int i = 0; i < kGrid * kGrid; ++i) {
      if (scores[i] > best_score) best_score = scores[best = i];
    }
    if (best < 0) return false;
    *pixel = grid_pixel(best);
    Ray ray;
    if (!camera_.ray(*pixel, &ray)) return false;
    const Miss miss{camera_, point, TangentPlane((point - ray.origin).normalized())};
    if (solve(miss, max_step, pixel)) {
      if (!jacobian) return true;
      Eigen::Vector2d f;
      Eigen::Matrix2d by_pixel;
      if (!miss(*pixel, &f) || !miss.jacobian(*pixel, f, 1e-3, &by_pixel) || !camera_.ray(*pixel, &ray)) {
        return false;
      }
      const Eigen::Vector3d m = point - ray.origin;
      const double depth = miss.plane.axis.dot(m);
      const Eigen::Vector2d c = miss.plane.tangents * m / depth;
      *jacobian = -by_pixel.inverse() * (miss.plane.tangents - c * miss.plane.axis.transpose()) / depth;
      return jacobian->allFinite();
    }
    for (int i = 0; i < kGrid * kGrid; ++i) {
      if (std::abs(i % kGrid - best % kGrid) <= kTried && std::abs(i / kGrid - best / kGrid) <= kTried) {
        scores[i] = -1;
      }
    }
  }
  return false;
}

}  // namespace raysfm
