#include "raysfm/camera/pixel_finder.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

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

  // d coordinates / d v where they are `c`.
  Eigen::Matrix<double, 2, 3> slope(const Eigen::Vector3d& v, const Eigen::Vector2d& c) const {
    return (tangents - c * axis.transpose()) / axis.dot(v);
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

  // df / dpixel by differences of `h` pixels, to the other side at the border of what the camera sees.
  bool jacobian(const Eigen::Vector2d& pixel, const Eigen::Vector2d& f, double h, Eigen::Matrix2d* j) const {
    for (int i = 0; i < 2; ++i) {
      Eigen::Vector2d next, step = h * Eigen::Vector2d::Unit(i);
      if (!(*this)(pixel + step, &next) && !(*this)(pixel + (step = -step), &next)) return false;
      j->col(i) = (next - f) / step[i];
    }
    return true;
  }
};

// Newton's method from `pixel`, where f and its derivative `j` are known, if not exactly. Steps are halved
// until they stay where the camera sees something and bring f down; none is longer than `max_step`, and a
// first one that would be starts too far away. While f falls fast the derivative follows by Broyden's
// updates, else it is computed again; with `exact_slope` also near the end, so that `j` is the derivative
// there to 1e-3.
bool solve(const Miss& miss, double max_step, bool exact_slope, Eigen::Vector2d f, Eigen::Vector2d* pixel,
           Eigen::Matrix2d* j) {
  constexpr int kMaxIterations = 30, kMaxHalvings = 8;
  constexpr double kTolerance = 1e-9, kDifference = 1e-2, kNear = 0.1;  // pixels
  constexpr double kFast = 0.1;
  Eigen::Vector2d p = *pixel;
  bool fresh = true;
  double rate = 1, from_slope = INFINITY;  // by which f fell, and the distance to where `j` was computed
  for (int i = 0; i < kMaxIterations; ++i) {
    Eigen::Vector2d step = -(j->inverse() * f);
    const double length = step.norm();
    if (!std::isfinite(length) || (i == 0 && length > max_step)) return false;
    if (length * rate < kTolerance) {
      *pixel = p + step;
      return !exact_slope || from_slope < kNear || miss.jacobian(p, f, kDifference, j);
    }
    step *= std::min(1.0, max_step / length);
    Eigen::Vector2d next = p + step, next_f = f;
    int halvings = 0;
    while (halvings <= kMaxHalvings && (!miss(next, &next_f) || !(next_f.squaredNorm() < f.squaredNorm()))) {
      ++halvings;
      next = p + (step *= 0.5);
    }
    const bool moved = halvings <= kMaxHalvings;
    if (!moved && fresh) return false;
    rate = moved ? next_f.norm() / f.norm() : 1;
    fresh = rate > kFast || (exact_slope && from_slope > kNear && rate * step.norm() < kNear);
    if (moved) {
      if (!fresh) *j += (next_f - f - *j * step) * step.transpose() / step.squaredNorm();
      p = next;
      f = next_f;
      from_slope += step.norm();
    }
    if (!fresh) continue;
    if (!miss.jacobian(p, f, kDifference, j)) return false;
    from_slope = 0;
  }
  return false;
}

// Cells of a cube around the origin: `n` x `n` on each of its six sides.
int cube_cell(const Eigen::Vector3d& direction, int n) {
  int axis = 0;
  const double largest = direction.cwiseAbs().maxCoeff(&axis);
  const auto index = [&](double along) {
    return std::clamp(static_cast<int>((along / largest + 1) * 0.5 * n), 0, n - 1);
  };
  const int side = 2 * axis + (direction[axis] < 0 ? 1 : 0);
  return (side * n + index(direction[(axis + 1) % 3])) * n + index(direction[(axis + 2) % 3]);
}

// The direction of a cell's centre, not of unit length.
Eigen::Vector3d cube_direction(int cell, int n) {
  const int side = cell / (n * n), axis = side / 2;
  Eigen::Vector3d direction;
  direction[axis] = side % 2 ? -1 : 1;
  direction[(axis + 1) % 3] = (cell / n % n + 0.5) * 2 / n - 1;
  direction[(axis + 2) % 3] = (cell % n + 0.5) * 2 / n - 1;
  return direction;
}

int largest_of(const float* scores, int count) {
  int best = -1;
  float best_score = -1;
  for (int i = 0; i < count; ++i) {
    if (scores[i] > best_score) best_score = scores[best = i];
  }
  return best;
}

}  // namespace

PixelFinder::PixelFinder(const Camera& camera) : camera_(camera), projects_(camera.can_project()) {
  if (projects_) return;
  tabulate_rays();
  tabulate_directions();
}

void PixelFinder::tabulate_rays() {
  constexpr int kCount = kGrid * kGrid;
  for (auto* array : {&ox_, &oy_, &oz_, &dx_, &dy_, &dz_}) array->assign(kCount, 0.0f);
  slopes_.assign(kCount, {});
  std::vector<Ray> rays(kCount);
  std::vector<Eigen::Vector3d> origins;
  for (int i = 0; i < kCount; ++i) {
    if (camera_.ray(grid_pixel(i), &rays[i]) && slope_at(grid_pixel(i), rays[i], &slopes_[i])) {
      origins.push_back(rays[i].origin);
    } else {
      rays[i] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
    }
    ox_[i] = static_cast<float>(rays[i].origin.x());
    oy_[i] = static_cast<float>(rays[i].origin.y());
    oz_[i] = static_cast<float>(rays[i].origin.z());
    dx_[i] = static_cast<float>(rays[i].direction.x());
    dy_[i] = static_cast<float>(rays[i].direction.y());
    dz_[i] = static_cast<float>(rays[i].direction.z());
  }
  for (const Eigen::Vector3d& origin : origins) centre_ += origin / static_cast<double>(origins.size());
  for (const Eigen::Vector3d& origin : origins) spread_ = std::max(spread_, (origin - centre_).norm());

  // What the pixels around a ray see lies within twice the angle to its farthest neighbour, and the table of
  // directions may be off by half a cell's diagonal.
  const double cell = std::sqrt(2.0) * (std::numbers::pi / 4) / (kCube / 2);
  min_cosine_.assign(kCount, -1);
  for (int i = 0; i < kCount; ++i) {
    double farthest = 0;
    for (int n = 0; n < 9; ++n) {
      const int column = i % kGrid + n % 3 - 1, row = i / kGrid + n / 3 - 1;
      if (column < 0 || row < 0 || column >= kGrid || row >= kGrid) continue;
      const Eigen::Vector3d& other = rays[row * kGrid + column].direction;
      if (!other.isZero(0))
        farthest = std::max(farthest, std::acos(std::min(1.0, rays[i].direction.dot(other))));
    }
    if (farthest > 0)
      min_cosine_[i] = static_cast<float>(std::cos(std::min(std::numbers::pi, 2 * farthest + cell)));
  }
}

// To one side where the other sees nothing.
bool PixelFinder::slope_at(const Eigen::Vector2d& pixel, const Ray& ray, Slope* slope) const {
  constexpr double kDifference = 0.25;  // pixels
  for (int i = 0; i < 2; ++i) {
    Ray next;
    Eigen::Vector2d step = kDifference * Eigen::Vector2d::Unit(i);
    if (!camera_.ray(pixel + step, &next) && !camera_.ray(pixel + (step = -step), &next)) return false;
    slope->direction.col(i) = ((next.direction - ray.direction) / step[i]).cast<float>();
    slope->origin.col(i) = ((next.origin - ray.origin) / step[i]).cast<float>();
  }
  return true;
}

void PixelFinder::tabulate_directions() {
  constexpr double kFar = 1e3;  // of the spread: origins do not matter
  nearest_.resize(6 * kCube * kCube);
  std::array<float, kGrid * kGrid> scores;
  for (size_t i = 0; i < nearest_.size(); ++i) {
    const Eigen::Vector3d direction = cube_direction(static_cast<int>(i), kCube);
    score((centre_ + std::max(1.0, kFar * spread_) * direction).cast<float>(), scores.data());
    nearest_[i] = largest_of(scores.data(), kGrid * kGrid);
  }
}

Eigen::Vector2d PixelFinder::grid_pixel(int ray) const {
  return {(ray % kGrid + 0.5) * camera_.width / kGrid - 0.5,
          (ray / kGrid + 0.5) * camera_.height / kGrid - 0.5};
}

bool PixelFinder::find(const Eigen::Vector3d& point_in_cam, Eigen::Vector2d* pixel,
                       Eigen::Matrix<double, 2, 3>* jacobian) const {
  return projects_ ? camera_.project(point_in_cam, pixel, jacobian) : search(point_in_cam, pixel, jacobian);
}

// Cosine of the angle between each ray of the grid and the point, squared with its sign. Not a number where
// there is no ray.
void PixelFinder::score(const Eigen::Vector3f& point, float* scores) const {
  const float x = point.x(), y = point.y(), z = point.z();
  const float *ox = ox_.data(), *oy = oy_.data(), *oz = oz_.data();
  const float *dx = dx_.data(), *dy = dy_.data(), *dz = dz_.data();
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const float mx = x - ox[i], my = y - oy[i], mz = z - oz[i];
    const float dot = mx * dx[i] + my * dy[i] + mz * dz[i];
    const float length2 = dx[i] * dx[i] + dy[i] * dy[i] + dz[i] * dz[i];  // 1, or 0: no ray
    scores[i] = dot * std::abs(dot) / ((mx * mx + my * my + mz * mz) * length2);
  }
}

bool PixelFinder::search(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                         Eigen::Matrix<double, 2, 3>* jacobian) const {
  constexpr double kNear = 100;  // of the spread: the table of directions may mislead
  const Eigen::Vector3d from_centre = point - centre_;
  const double distance = from_centre.norm();
  if (!(distance > 0) || !std::isfinite(distance)) return false;
  const int ray = nearest_[cube_cell(from_centre, kCube)];
  if (ray < 0) return false;
  const Eigen::Vector3d from_origin = point - Eigen::Vector3d(ox_[ray], oy_[ray], oz_[ray]);
  const double cosine = Eigen::Vector3d(dx_[ray], dy_[ray], dz_[ray]).dot(from_origin) / from_origin.norm();
  const bool plausible = cosine >= min_cosine_[ray];
  if (plausible && solve_from(ray, point, pixel, jacobian)) return true;
  return (plausible || distance < kNear * spread_) && search_all(point, ray, pixel, jacobian);
}

// From the rays of the grid nearest to the point, less those around `tried`.
bool PixelFinder::search_all(const Eigen::Vector3d& point, int tried, Eigen::Vector2d* pixel,
                             Eigen::Matrix<double, 2, 3>* jacobian) const {
  constexpr int kAttempts = 3, kApart = 1;  // rays of the grid between two attempts
  constexpr double kFar = 1e6;              // beyond it floats do not tell origins apart
  std::array<float, kGrid * kGrid> scores;
  score((point * std::min(1.0, kFar / point.norm())).cast<float>(), scores.data());
  scores[tried] = -1;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const int best = largest_of(scores.data(), kGrid * kGrid);
    if (best < 0 || !(scores[best] > 0)) return false;
    if (solve_from(best, point, pixel, jacobian)) return true;
    for (int i = 0; i < kGrid * kGrid; ++i) {
      const bool near =
          std::abs(i % kGrid - best % kGrid) <= kApart && std::abs(i / kGrid - best / kGrid) <= kApart;
      if (near) scores[i] = -1;
    }
  }
  return false;
}

bool PixelFinder::solve_from(int start, const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                             Eigen::Matrix<double, 2, 3>* jacobian) const {
  const double max_step = 4.0 * std::max(camera_.width, camera_.height) / kGrid;
  const Eigen::Vector3d origin(ox_[start], oy_[start], oz_[start]);
  const Eigen::Vector3d direction(dx_[start], dy_[start], dz_[start]);
  const Miss miss{camera_, point, TangentPlane((point - origin).normalized())};
  Eigen::Vector2d seen;
  if (!miss.plane.coordinates(direction, &seen)) return false;
  *pixel = grid_pixel(start);
  const Slope& slope = slopes_[start];
  Eigen::Matrix2d by_pixel =
      -miss.plane.slope(point - origin, Eigen::Vector2d::Zero()) * slope.origin.cast<double>() -
      miss.plane.slope(direction, seen) * slope.direction.cast<double>();
  if (!solve(miss, max_step, jacobian != nullptr, -seen, pixel, &by_pixel)) return false;
  if (!jacobian) return true;
  Ray ray;
  if (!camera_.ray(*pixel, &ray) || !miss.plane.coordinates(ray.direction, &seen)) return false;
  *jacobian = -by_pixel.inverse() * miss.plane.slope(point - ray.origin, seen);
  return jacobian->allFinite();
}

}  // namespace raysfm
