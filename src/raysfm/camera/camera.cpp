#include "raysfm/camera/camera.h"

#include <cmath>
#include <limits>
#include <utility>

namespace raysfm {
namespace {

// std::visit calls through a table when a variant has more than eleven alternatives, which costs the fastest
// models a fifth of their time. This compares the index, so that they are inlined.
template <typename Visit, size_t... I>
bool visit_model(const CameraModel& model, Visit visit, std::index_sequence<I...>) {
  bool result = false;
  (void)((model.index() == I ? (result = visit(*std::get_if<I>(&model)), true) : false) || ...);
  return result;
}
template <typename Visit>
bool visit_model(const CameraModel& model, Visit visit) {
  return visit_model(model, visit, std::make_index_sequence<std::variant_size_v<CameraModel>>{});
}

// Solid angle of one pixel around `pixel`; false where it sees nothing.
bool solid_angle(const Camera& camera, const Eigen::Vector2d& pixel, double* steradians) {
  Ray left, right, top, bottom;
  if (!camera.ray(pixel - Eigen::Vector2d(0.5, 0), &left) ||
      !camera.ray(pixel + Eigen::Vector2d(0.5, 0), &right) ||
      !camera.ray(pixel - Eigen::Vector2d(0, 0.5), &top) ||
      !camera.ray(pixel + Eigen::Vector2d(0, 0.5), &bottom)) {
    return false;
  }
  *steradians = (right.direction - left.direction).cross(bottom.direction - top.direction).norm();
  return *steradians > 0;
}

}  // namespace

bool Camera::ray(const Eigen::Vector2d& pixel, Ray* ray) const {
  return visit_model(model, [&](const auto& m) { return model_ray(m, pixel, ray); });
}

bool Camera::project(const Eigen::Vector3d& point_in_cam, Eigen::Vector2d* pixel,
                     Eigen::Matrix<double, 2, 3>* jacobian) const {
  return visit_model(model, [&](const auto& m) {
    if constexpr (ProjectiveModel<std::decay_t<decltype(m)>>) {
      return m.project(point_in_cam, pixel, jacobian);
    } else {
      return false;
    }
  });
}

bool Camera::can_project() const {
  return std::visit([](const auto& m) { return ProjectiveModel<std::decay_t<decltype(m)>>; }, model);
}

double Camera::exposed_after(const Eigen::Vector2d& pixel) const {
  using Direction = RollingShutter::Direction;
  const bool by_rows = shutter.direction == Direction::kDown || shutter.direction == Direction::kUp;
  const double part = by_rows ? (pixel.y() + 0.5) / height - 0.5 : (pixel.x() + 0.5) / width - 0.5;
  const bool forwards = shutter.direction == Direction::kDown || shutter.direction == Direction::kRight;
  return (forwards ? part : -part) * shutter.readout;
}

double Camera::pixels_per_radian() const {
  // The centre of the image may see nothing (a mirror's camera sees itself there): take the pixel of a coarse
  // grid that is nearest to it.
  constexpr int kGrid = 16;
  const Eigen::Vector2d centre(0.5 * (width - 1), 0.5 * (height - 1));
  double steradians = 0;
  if (solid_angle(*this, centre, &steradians)) return 1 / std::sqrt(steradians);
  double nearest = std::numeric_limits<double>::infinity();
  double result = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const Eigen::Vector2d pixel((i % kGrid + 0.5) * width / kGrid, (i / kGrid + 0.5) * height / kGrid);
    const double distance = (pixel - centre).norm();
    if (distance < nearest && solid_angle(*this, pixel, &steradians)) {
      nearest = distance;
      result = 1 / std::sqrt(steradians);
    }
  }
  return result;
}

std::string_view model_name(const CameraModel& model) {
  return std::visit([](const auto& m) { return m.kName; }, model);
}

}  // namespace raysfm
