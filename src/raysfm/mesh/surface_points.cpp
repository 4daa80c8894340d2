#include "raysfm/mesh/surface_points.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace raysfm {
namespace {

constexpr double kMostRelativeSigma = 0.02;  // of the distance to the nearest view
constexpr double kMostError = 4;             // times the error of reprojection, of one ray to its point
constexpr double kLeastErrorPx = 0.3;
constexpr int kLeastRays = 2, kUsualRays = 3;
constexpr double kWideAngle = 0.05;  // radians between rays of points that only two see

// A ray that sees a point, in the world.
struct WorldRay {
  Ray ray;
  double angle = 0;  // radians between it and the next pixel's
  int view = 0;
};

bool world_ray(const MeshScene& scene, const Sight& sight, WorldRay* out) {
  const MeshView& view = scene.views[sight.view];
  const Camera& camera = scene.cameras[view.camera];
  Ray ray, right, below;
  if (!camera.ray(sight.pixel, &ray)) return false;
  const bool has_right = camera.ray(sight.pixel + Eigen::Vector2d(1, 0), &right);
  const bool has_below = camera.ray(sight.pixel + Eigen::Vector2d(0, 1), &below);
  if (!has_right && !has_below) return false;
  const double across = has_right ? (right.direction - ray.direction).norm() : 0;
  const double down = has_below ? (below.direction - ray.direction).norm() : 0;
  out->angle = std::max(across, down);
  out->view = sight.view;
  out->ray.origin = view.world_from_cam * ray.origin;
  out->ray.direction = view.world_from_cam.rotation * ray.direction;
  return out->angle > 0;
}

// Rays that pass the point within a few pixels.
std::vector<WorldRay> good_rays(const MeshScene& scene, const Eigen::Vector3d& point, const Sight* first,
                                const Sight* last) {
  const double most = kMostError * std::max(kLeastErrorPx, scene.error_px);
  std::vector<WorldRay> rays;
  for (const Sight* sight = first; sight != last; ++sight) {
    WorldRay ray;
    if (!world_ray(scene, *sight, &ray)) continue;
    const Eigen::Vector3d to_point = point - ray.ray.origin;
    const double along = to_point.dot(ray.ray.direction);
    const double off = (to_point - along * ray.ray.direction).norm();
    // Twice as far off where a skew moves pixels, which no ray has.
    const double skew = std::abs(scene.skews[scene.views[sight->view].camera]);
    if (along > 0 && off <= (most + skew) * ray.angle * along) rays.push_back(ray);
  }
  return rays;
}

double widest_angle(const std::vector<WorldRay>& rays) {
  double cosine = 1;
  for (size_t i = 1; i < rays.size(); ++i)
    cosine = std::min(cosine, rays[0].ray.direction.dot(rays[i].ray.direction));
  return std::acos(std::clamp(cosine, -1.0, 1.0));
}

bool measure(const MeshScene& scene, const std::vector<WorldRay>& rays, SurfacePoint* point) {
  const double pixels = std::max(kLeastErrorPx, scene.error_px);
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  double nearest = std::numeric_limits<double>::infinity();
  point->pixel = nearest;
  for (const WorldRay& r : rays) {
    const double distance = (point->position - r.ray.origin).norm();
    const double sigma = pixels * r.angle * distance;
    nearest = std::min(nearest, distance);
    point->pixel = std::min(point->pixel, r.angle * distance);
    information +=
        (Eigen::Matrix3d::Identity() - r.ray.direction * r.ray.direction.transpose()) / (sigma * sigma);
  }
  const double least =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(information, Eigen::EigenvaluesOnly).eigenvalues()[0];
  point->sigma = 1 / std::sqrt(std::max(least, 1e-300));
  return point->sigma <= kMostRelativeSigma * nearest;
}

}  // namespace

std::vector<SurfacePoint> surface_points(const MeshScene& scene) {
  std::vector<Sight> sights = scene.sights;
  std::ranges::stable_sort(sights, {}, &Sight::point);
  std::vector<SurfacePoint> points;
  std::vector<double> relative;
  for (size_t first = 0, last = 0; first < sights.size(); first = last) {
    const MapPoint& map_point = scene.points[sights[first].point];
    while (last < sights.size() && sights[last].point == sights[first].point) ++last;
    if (!map_point.position.allFinite()) continue;
    const std::vector<WorldRay> rays =
        good_rays(scene, map_point.position, &sights[first], sights.data() + last);
    const int count = static_cast<int>(rays.size());
    if (count < kLeastRays || (count < kUsualRays && widest_angle(rays) < kWideAngle)) continue;
    SurfacePoint point{map_point.position, 0, 0, map_point.rgb, {}, {}};
    if (!measure(scene, rays, &point)) continue;
    for (const WorldRay& ray : rays) {
      point.eyes.push_back(ray.ray.origin);
      point.views.push_back(ray.view);
    }
    points.push_back(std::move(point));
  }
  std::ranges::stable_sort(points, {}, &SurfacePoint::sigma);
  return points;
}

}  // namespace raysfm
