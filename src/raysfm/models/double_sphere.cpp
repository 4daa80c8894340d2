#include "raysfm/models/double_sphere.h"

#include <cmath>

namespace raysfm {

bool DoubleSphere::project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                           Eigen::Matrix<double, 2, 3>* jacobian) const {
  const double d1 = point.norm();
  if (!(d1 > 0) || !std::isfinite(d1)) return false;
  const double q = point.head<2>().squaredNorm();
  const double z1 = xi * d1 + point.z();
  const double d2 = std::sqrt(q + z1 * z1);
  const double w1 = alpha <= 0.5 ? alpha / (1 - alpha) : (1 - alpha) / alpha;
  if (!(z1 > -w1 * d2)) return false;
  const double w = alpha * d2 + (1 - alpha) * z1;
  if (!(q < kMaxRadius * kMaxRadius * w * w) || !(w > 0)) return false;
  const double inverse_w = 1 / w;
  const Eigen::Vector2d m = point.head<2>() * inverse_w;
  *pixel = {fx * m.x() + cx, fy * m.y() + cy};
  if (jacobian) {
    Eigen::RowVector3d dz1 = (xi / d1) * point.transpose();
    dz1.z() += 1;
    Eigen::RowVector3d dw = (alpha * z1 / d2 + (1 - alpha)) * dz1;
    dw.head<2>() += (alpha / d2) * point.head<2>().transpose();
    const Eigen::Vector2d f(fx * inverse_w, fy * inverse_w);
    *jacobian = -f.cwiseProduct(m) * dw;
    (*jacobian)(0, 0) += f.x();
    (*jacobian)(1, 1) += f.y();
  }
  return true;
}

bool DoubleSphere::unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
  const double mx = (pixel.x() - cx) / fx, my = (pixel.y() - cy) / fy;
  const double r2 = mx * mx + my * my;
  const double root = 1 - (2 * alpha - 1) * r2;
  if (!(r2 < kMaxRadius * kMaxRadius) || !(root > 0)) return false;
  const double mz = (1 - alpha * alpha * r2) / (alpha * std::sqrt(root) + 1 - alpha);
  const double second_root = mz * mz + (1 - xi * xi) * r2;
  if (!(second_root >= 0)) return false;
  const double scale = (mz * xi + std::sqrt(second_root)) / (mz * mz + r2);
  *direction = Eigen::Vector3d(scale * mx, scale * my, scale * mz - xi).normalized();
  return true;
}

std::optional<ParameterProblem> DoubleSphere::problem() const {
  if (!(xi > -1 && xi <= 1)) return ParameterProblem{"xi", xi, "above -1, at most 1"};
  if (!(alpha >= 0 && alpha <= 1)) return ParameterProblem{"alpha", alpha, "between 0 and 1"};
  return std::nullopt;
}

}  // namespace raysfm
