#include "raysfm/calibration/rig_parameters.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <type_traits>
#include <variant>

#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

// Cameras of a rig: radians, and a part of the distance from the first camera.
constexpr double kTurnPrior = 0.02, kShiftPrior = 0.02;
constexpr double kStep = 1e-3;  // of the standard deviation of a usual prior
constexpr CalibrationPrior kUsual;
// How much farther than usual the numbers of a lens may be off that was found as if no shutter rolled.
constexpr double kBent = 5;
// Standard deviations.
constexpr double kOtherLens = 4;

std::span<const std::string_view> names_of(const CameraModel& model) {
  return std::visit(
      [](const auto& m) -> std::span<const std::string_view> {
        using Model = std::decay_t<decltype(m)>;
        if constexpr (ParametricModel<Model>) return Model::kParameterNames;
        return {};
      },
      model);
}

int index_of(const CameraModel& model, std::string_view name) {
  const std::span<const std::string_view> names = names_of(model);
  const auto it = std::find(names.begin(), names.end(), name);
  return it == names.end() ? -1 : static_cast<int>(it - names.begin());
}

// The model with its numbers changed by edit(numbers).
template <typename Edit>
CameraModel edited(const CameraModel& model, Edit edit) {
  return std::visit(
      [&](const auto& m) -> CameraModel {
        using Model = std::decay_t<decltype(m)>;
        if constexpr (ParametricModel<Model>) {
          auto numbers = m.parameters();
          edit(std::span<double>(numbers));
          return Model::from_parameters(numbers);
        } else {
          return m;
        }
      },
      model);
}

double number_of(const CameraModel& model, int index) {
  return std::visit(
      [&](const auto& m) -> double {
        if constexpr (ParametricModel<std::decay_t<decltype(m)>>) return m.parameters()[index];
        return 0;
      },
      model);
}

// Tangent of the angle at which the camera sees its farthest corner, at most 1.
double rim_of(const Camera& camera) {
  double rim = 0;
  for (const double x : {0.0, camera.width - 1.0}) {
    for (const double y : {0.0, camera.height - 1.0}) {
      Ray ray;
      if (!camera.ray({x, y}, &ray)) continue;
      const double angle = std::atan2(ray.direction.head<2>().norm(), ray.direction.z());
      rim = std::max(rim, angle < 0.78 ? std::tan(angle) : 1.0);
    }
  }
  return rim > 0 ? rim : 1.0;
}

RollingShutter shutter_of(int axis, double readout) {
  using Direction = RollingShutter::Direction;
  const Direction forwards = axis == 0 ? Direction::kDown : Direction::kRight;
  const Direction backwards = axis == 0 ? Direction::kUp : Direction::kLeft;
  return {std::abs(readout), readout < 0 ? backwards : forwards};
}

// Of shutter_of(): 0 where it is that of the other axis.
double readout_along(int axis, const RollingShutter& shutter) {
  for (const double sign : {-1.0, 1.0}) {
    if (shutter_of(axis, sign).direction == shutter.direction) return sign * shutter.readout;
  }
  return 0;
}

bool is_of_model(RigParameters::Kind kind) {
  using Kind = RigParameters::Kind;
  return kind == Kind::kFocal || kind == Kind::kAspect || kind == Kind::kNumber;
}

void change_numbers(const RigParameters::Parameter& p, double value, const CameraModel& model,
                    std::span<double> numbers) {
  using Kind = RigParameters::Kind;
  if (p.kind == Kind::kNumber) {
    numbers[p.index] += value;
  } else {
    if (p.kind == Kind::kFocal) numbers[index_of(model, "fx")] *= std::exp(value);
    numbers[index_of(model, "fy")] *= std::exp(value);
  }
}

// What is not of its model.
void change(const RigParameters::Parameter& p, double value, Camera* camera) {
  using Kind = RigParameters::Kind;
  switch (p.kind) {
    case Kind::kFocal:
    case Kind::kAspect:
    case Kind::kNumber:
      return;
    case Kind::kTurn: {
      Eigen::Quaterniond& rotation = camera->rig_from_cam.rotation;
      rotation = (rotation * exp_so3(value * Eigen::Vector3d::Unit(p.index))).normalized();
      return;
    }
    case Kind::kShift:
      camera->rig_from_cam.translation[p.index] += value;
      return;
    case Kind::kReadout:
      if (std::abs(value) > camera->shutter.readout) camera->shutter = shutter_of(p.index, value);
      return;
  }
}

}  // namespace

bool are_other_lenses(double focal_a, double focal_b, double sigma) {
  return std::abs(std::log(focal_a / focal_b)) > kOtherLens * std::hypot(kUsual.focal, sigma);
}

RigParameters::RigParameters(const Rig& given, double doubt, const CalibrationPrior& prior)
    : given_(given), doubt_(doubt), prior_(prior) {
  for (int c = 0; c < static_cast<int>(given_.cameras.size()); ++c) {
    Camera& camera = given_.cameras[c];
    if (const Pinhole* p = std::get_if<Pinhole>(&camera.model))
      camera.model = Radtan{p->fx, p->fy, p->cx, p->cy};
    add_model(c);
    if (c == 0) continue;
    const double distance =
        (camera.rig_from_cam.translation - given_.cameras[0].rig_from_cam.translation).norm();
    for (int axis = 0; axis < 3; ++axis) add(c, Kind::kTurn, axis, kTurnPrior, kTurnPrior);
    if (!(distance > 0)) continue;
    const double shift = kShiftPrior * distance;
    for (int axis = 0; axis < 3; ++axis) add(c, Kind::kShift, axis, shift, shift);
  }
  first_values_ = Eigen::VectorXd::Zero(size());
  if (prior_.readout > 0 && size() > 0) add_readout();
}

// The present shutter is where the unknowns start from, and no part of what is given.
void RigParameters::add_readout() {
  const RollingShutter found = given_.cameras[0].shutter;
  for (Camera& camera : given_.cameras) camera.shutter = {};
  for (int axis = 0; axis < 2; ++axis) add(0, Kind::kReadout, axis, prior_.readout, prior_.readout);
  first_values_ = Eigen::VectorXd::Zero(size());
  first_values_.tail<2>() << readout_along(0, found), readout_along(1, found);
}

void RigParameters::add(int camera, Kind kind, int index, double prior_sigma, double usual_sigma) {
  const double sigma = doubt_ * prior_sigma;
  const bool may_be_bent = prior_.without_shutter && (kind == Kind::kFocal || kind == Kind::kNumber);
  const double bent = may_be_bent ? std::max(sigma, kBent * usual_sigma) : sigma;
  parameters_.push_back({camera, kind, index, sigma, bent, kStep * usual_sigma});
}

void RigParameters::add_model(int c) {
  const Camera& camera = given_.cameras[c];
  const auto number = [&](std::string_view name, double CalibrationPrior::*sigma, double unit) {
    const int index = index_of(camera.model, name);
    if (index >= 0) add(c, Kind::kNumber, index, unit * prior_.*sigma, unit * kUsual.*sigma);
  };
  if (index_of(camera.model, "fx") >= 0 && !std::holds_alternative<Equirectangular>(camera.model)) {
    add(c, Kind::kFocal, 0, prior_.focal, kUsual.focal);
    add(c, Kind::kAspect, 0, prior_.aspect, kUsual.aspect);
    number("cx", &CalibrationPrior::centre, camera.longer_side());
    number("cy", &CalibrationPrior::centre, camera.longer_side());
  }
  const double rim = rim_of(camera);
  if (std::holds_alternative<Radtan>(camera.model) || std::holds_alternative<Rational>(camera.model)) {
    number("k1", &CalibrationPrior::rim, std::pow(rim, -2));
    number("k2", &CalibrationPrior::rim, std::pow(rim, -4));
  }
  if (std::holds_alternative<KannalaBrandt>(camera.model)) {
    for (int i = 1; i <= 4; ++i)
      number("k" + std::to_string(i), &CalibrationPrior::rim, std::pow(rim, -2 * i));
  }
  for (const std::string_view name : {"xi", "alpha", "beta"}) number(name, &CalibrationPrior::rim, 1);
}

std::string RigParameters::name(int i) const {
  const Parameter& p = parameters_[i];
  switch (p.kind) {
    case Kind::kFocal:
      return "fx";
    case Kind::kAspect:
      return "fy";
    case Kind::kNumber:
      return std::string(names_of(given_.cameras[p.camera].model)[p.index]);
    case Kind::kTurn:
      return "rotation[" + std::to_string(p.index) + "]";
    case Kind::kShift:
      return "translation[" + std::to_string(p.index) + "]";
    case Kind::kReadout:
      return p.index == 0 ? "readout_down" : "readout_right";
  }
  return {};
}

double RigParameters::number(int i, int c, const Rig& rig) const {
  const Parameter& p = parameters_[i];
  const Camera& camera = rig.cameras[c];
  if (p.kind == Kind::kShift) return camera.rig_from_cam.translation[p.index];
  if (p.kind == Kind::kReadout) return readout_along(p.index, camera.shutter);
  if (p.kind == Kind::kTurn) {
    return log_so3(given_.cameras[c].rig_from_cam.rotation.conjugate() *
                   camera.rig_from_cam.rotation)[p.index];
  }
  return number_of(camera.model, p.kind == Kind::kNumber ? p.index : index_of(camera.model, name(i)));
}

// Where focal lengths are given that differ by more than calibrations are off, lenses do.
bool RigParameters::is_like_first(int camera) const {
  const Camera &a = given_.cameras[0], &b = given_.cameras[camera];
  if (a.model.index() != b.model.index() || a.width != b.width || a.height != b.height) return false;
  const int focal = index_of(a.model, "fx");
  if (focal < 0) return true;
  return !are_other_lenses(number_of(b.model, focal), number_of(a.model, focal));
}

bool RigParameters::concerns(int i, int camera) const {
  if (parameters_[i].kind == Kind::kReadout) return true;
  const int owner = parameters_[i].camera;
  return owner == camera || (owner == 0 && is_like_first(camera));
}

// A model is made once, which is more work than to change its numbers.
Rig RigParameters::rig(const Eigen::VectorXd& values) const {
  Rig rig = given_;
  for (int c = 0; c < static_cast<int>(rig.cameras.size()); ++c) {
    std::vector<int> of_model;
    for (int i = 0; i < size(); ++i) {
      if (values[i] == 0 || !concerns(i, c)) continue;
      if (is_of_model(parameters_[i].kind)) {
        of_model.push_back(i);
      } else {
        change(parameters_[i], values[i], &rig.cameras[c]);
      }
    }
    if (of_model.empty()) continue;
    const CameraModel& given = given_.cameras[c].model;
    rig.cameras[c].model = edited(given, [&](std::span<double> numbers) {
      for (const int i : of_model) change_numbers(parameters_[i], values[i], given, numbers);
    });
  }
  return rig;
}

Eigen::VectorXd RigParameters::prior_sigma(bool is_bent) const {
  Eigen::VectorXd sigma(size());
  for (int i = 0; i < size(); ++i)
    sigma[i] = is_bent ? parameters_[i].bent_sigma : parameters_[i].prior_sigma;
  return sigma;
}

}  // namespace raysfm
