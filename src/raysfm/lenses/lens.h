#pragma once

#include <Eigen/Core>

namespace raysfm {

// The five numbers of a lens: fx, fy, cx, cy, skew; pixels.
using LensVector = Eigen::Matrix<double, 5, 1>;

// A pinhole whose intrinsics are not known beforehand: K of IFBA01 equation 4. Pixels; fx, fy > 0.
struct Lens {
  double fx = 1, fy = 1, cx = 0, cy = 0, skew = 0;

  static Lens from_vector(const LensVector& k) { return {k[0], k[1], k[2], k[3], k[4]}; }
  LensVector vector() const { return (LensVector() << fx, fy, cx, cy, skew).finished(); }
  Eigen::Matrix3d matrix() const {
    return (Eigen::Matrix3d() << fx, skew, cx, 0, fy, cy, 0, 0, 1).finished();
  }
  // Pixel of the point (x, y, 1) of the normalised image plane.
  Eigen::Vector2d pixel(const Eigen::Vector2d& m) const {
    return {fx * m.x() + skew * m.y() + cx, fy * m.y() + cy};
  }
  // The other way round.
  Eigen::Vector2d normalised(const Eigen::Vector2d& pixel) const {
    const double y = (pixel.y() - cy) / fy;
    return {(pixel.x() - cx - skew * y) / fx, y};
  }
};

}  // namespace raysfm
