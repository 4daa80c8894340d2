#include "raysfm/worlds/walker.h"

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>

namespace raysfm::synth {

namespace {

// Distance along the way there and back, in [0, 2 length).
double stage_of_round(const Walker& w, double time) {
  const double round = 2.0 * (w.to - w.from).norm();
  const double walked = std::fmod(w.phase + w.speed * time, round);
  return walked < 0 ? walked + round : walked;
}

// A limb of `length` that hangs from `joint`, swung forward by `angle`.
Ellipsoid limb(const Eigen::Vector3d& joint, const Eigen::Matrix3d& body, double angle, double length,
               double thickness, const Finish& finish) {
  const Eigen::AngleAxisd swing(-angle, Eigen::Vector3d::UnitX());
  const Eigen::Matrix3d axes = body * swing.toRotationMatrix().transpose();
  return {joint + 0.5 * length * axes.col(1), axes, {thickness, 0.54 * length, thickness}, finish};
}

}  // namespace

Eigen::Vector3d Walker::place(double time) const {
  const double length = (to - from).norm();
  const double s = stage_of_round(*this, time);
  return from + (s < length ? s : 2.0 * length - s) / length * (to - from);
}

Eigen::Vector3d Walker::heading(double time) const {
  const Eigen::Vector3d there = (to - from).normalized();
  return stage_of_round(*this, time) < (to - from).norm() ? there : Eigen::Vector3d(-there);
}

void Walker::pose(double time, std::vector<Ellipsoid>* body) const {
  const Eigen::Vector3d forward = heading(time), down = Eigen::Vector3d::UnitY();
  Eigen::Matrix3d axes;
  axes << down.cross(forward), down, forward;
  const double stride = 2.0 * std::numbers::pi * (phase + speed * time) / (0.8 * height);
  const double swing = 0.5 * std::sin(stride);
  const double h = height;
  const Eigen::Vector3d hip = place(time) - (0.50 + 0.012 * std::cos(2.0 * stride)) * h * down;
  const Eigen::Vector3d neck = hip - 0.33 * h * down;

  body->push_back({neck - 0.09 * h * down, axes, {0.047 * h, 0.068 * h, 0.056 * h}, skin});
  body->push_back({hip - 0.17 * h * down, axes, {0.115 * h, 0.19 * h, 0.075 * h}, coat});
  body->push_back({hip, axes, {0.10 * h, 0.075 * h, 0.075 * h}, trousers});
  for (const double side : {-1.0, 1.0}) {
    const Eigen::Vector3d across = side * axes.col(0);
    const double leg = side * swing;
    const double bend = 0.25 + 0.25 * std::sin(stride + (side > 0 ? 1.6 : 4.7));
    body->push_back(limb(hip + 0.05 * h * across, axes, leg, 0.25 * h, 0.048 * h, trousers));
    const Eigen::Vector3d knee =
        hip + 0.05 * h * across + 0.25 * h * (std::cos(leg) * down + std::sin(leg) * forward);
    body->push_back(limb(knee, axes, leg - bend, 0.25 * h, 0.035 * h, trousers));
    body->push_back(limb(neck + 0.115 * h * across, axes, -0.8 * leg, 0.36 * h, 0.030 * h, coat));
  }
}

}  // namespace raysfm::synth
