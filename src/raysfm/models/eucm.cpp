#include "raysfm/models/eucm.h"

#include <cmath>

namespace raysfm {

bool Eucm::project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                   Eigen::Matrix<double, 2, 3>* jacobian) const {
  const double q = point.head<2>().squaredNorm();
  const double d = std::sqrt(beta * q + point.z() * point.z());
  if (!(d > 0) || !std::isfinite(d)) return false;
  const double w1 = alpha <= 0.5 ? alpha / (1 - alpha) : (1 - alpha) / alpha;
  if (!(point.z() > -w1 * d)) return false;
  const double w = alpha * d + (1 - alpha) * point.z();
  if (!(q < kMaxRadius * kMaxRadius * w * w) || !(w > 0)) return false;
  const double inverse_w = 1 / w;
  const Eigen::Vector2d m = point.head<2>() * inverse_w;
  *pixel = {fx * m.x() + cx, fy * m.y() + cy};
  if (jacobian) {
    const double slope = alpha / d;
    const Eigen::RowVector3d dw(slope * beta * point.x(), slope * beta * point.y(),
                                slope * point.z() + (1 - alpha));
    const Eigen::Vector2d f(fx * inverse_w, fy * inverse_w);
    *jacobian = -f.cwiseProduct(m) * dw;
    (*jacobian)(0, 0) += f.x();
    (*jacobian)(1, 1) += f.y();
  }
  return true;
}

bool Eucm::unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
  const double mx = (pixel.x() - cx) / fx, my = (pixel.y() - cy) / fy;
  const double r2 = mx * mx + my * my;
  const double root = 1 - (2 * alpha - 1) * beta * r2;
  if (!(r2 < kMaxRadius * kMaxRadius) || !(root > 0)) return false;
  const double mz = (1 - beta * alpha * alpha * r2) / (alpha * std::sqrt(root) + 1 - alpha);
  *direction = Eigen::Vector3d(mx, my, mz).normalized();
  return direction->allFinite();
}

std::optional<ParameterProblem> Eucm::problem() const {
  if (!(alpha >= 0 && alpha <= 1)) return ParameterProblem{"alpha", alpha, "between 0 and 1"};
  if (!(beta > 0 && beta <= 1e3)) return ParameterProblem{"beta", beta, "above 0, at most 1000"};
  return std::nullopt;
}

}  // namespace raysfm
