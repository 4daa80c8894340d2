#pragma once

#include <Eigen/Core>
#include <vector>

namespace raysfm::synth {

// Uniform B-spline of degree five: four times continuously differentiable, straight and of constant speed
// where its control points are evenly spaced on a line. One unit of the parameter is one control point.
class Curve {
 public:
  // An open curve goes on straight beyond its ends and begins and ends at its first and last control point
  // (when the two nearest to them continue in line). At least two points.
  Curve(std::vector<Eigen::Vector3d> points, bool closed);

  Eigen::Vector3d position(double x) const;
  Eigen::Vector3d derivative(double x) const;  // by the parameter
  double period() const { return static_cast<double>(points_.size()); }

 private:
  Eigen::Vector3d point(long i) const;

  std::vector<Eigen::Vector3d> points_;
  bool closed_;
};

}  // namespace raysfm::synth
