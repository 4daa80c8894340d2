#include "raysfm/models/mirror.h"

#include <cmath>

namespace raysfm {

bool Mirror::ray(const Eigen::Vector2d& pixel, Ray* ray) const {
  const Eigen::Vector3d in_camera =
      Eigen::Vector3d((pixel.x() - cx) / fx, (pixel.y() - cy) / fy, 1).normalized();
  const Eigen::Vector3d o = -(rotation.transpose() * apex);
  const Eigen::Vector3d d = rotation.transpose() * in_camera;
  // The surface along the ray: a t^2 + 2 b t + c = 0, positive in front of the mirror. The ray enters where
  // that falls, at the root with -sqrt, in the form that does not cancel.
  const double k = 1 + conic;
  const double a = d.x() * d.x() + d.y() * d.y() + k * d.z() * d.z();
  const double b = o.x() * d.x() + o.y() * d.y() + k * o.z() * d.z() - radius * d.z();
  const double c = o.x() * o.x() + o.y() * o.y() + k * o.z() * o.z() - 2 * radius * o.z();
  const double discriminant = b * b - a * c;
  if (!(discriminant > 0)) return false;
  const double root = std::sqrt(discriminant);
  const double t = b < 0 ? c / (root - b) : -(b + root) / a;
  if (!(t > 0) || !std::isfinite(t)) return false;
  const Eigen::Vector3d hit = o + t * d;
  const Eigen::Vector3d normal(hit.x(), hit.y(), k * hit.z() - radius);  // towards the camera
  // On the half that holds the apex the normal points back along the axis.
  if (!(normal.z() < 0) || !(hit.head<2>().squaredNorm() <= rim * rim)) return false;
  const Eigen::Vector3d reflected = d - (2 * d.dot(normal) / normal.squaredNorm()) * normal;
  ray->origin = rotation * hit + apex;
  ray->direction = (rotation * reflected).normalized();
  if (ray->origin.z() * ray->direction.z() < 0) {
    const double s = -ray->origin.z() / ray->direction.z();
    const Eigen::Vector2d at = (ray->origin + s * ray->direction).head<2>();
    if (at.squaredNorm() <= body * body) return false;
  }
  return true;
}

std::optional<ParameterProblem> Mirror::problem() const {
  if (!(radius > 0 && radius <= 1e6))
    return ParameterProblem{"mirror.radius", radius, "above 0, at most 1e6"};
  if (!(std::abs(conic) <= 1e6)) return ParameterProblem{"mirror.conic", conic, "between -1e6 and 1e6"};
  if (!(rim > 0 && rim <= 1e6)) return ParameterProblem{"mirror.rim", rim, "above 0, at most 1e6"};
  if (!((1 + conic) * rim * rim < radius * radius)) {
    return ParameterProblem{"mirror.rim", rim, "below radius / sqrt(1 + conic), where the surface ends"};
  }
  if (!(std::abs(quaternion.norm() - 1) < 1e-3)) {
    return ParameterProblem{"mirror.rotation[3]", quaternion.w(), "[qx, qy, qz, qw] of length 1"};
  }
  if (!(rotation.col(2).dot(apex) > 0)) {
    return ParameterProblem{"mirror.apex[2]", apex.z(), "the camera in front of the apex"};
  }
  if (!(body >= 0)) return ParameterProblem{"mirror.body", body, "at least 0"};
  return std::nullopt;
}

std::array<double, 15> Mirror::parameters() const {
  const Eigen::Vector4d q = quaternion.coeffs();
  return {fx, fy, cx, cy, radius, conic, rim, apex.x(), apex.y(), apex.z(), q.x(), q.y(), q.z(), q.w(), body};
}

Mirror Mirror::from_parameters(const std::array<double, 15>& p) {
  const Eigen::Quaterniond q(p[13], p[10], p[11], p[12]);
  return {p[0], p[1], p[2], p[3], p[4], p[5], p[6], {p[7], p[8], p[9]}, q.normalized().toRotationMatrix(),
          q,    p[14]};
}

}  // namespace raysfm
