#include "raysfm/camera/model_starts.h"

#include <algorithm>
#include <type_traits>
#include <utility>

namespace raysfm {
namespace {

constexpr double kPerspectiveAngle = 80 * 3.14159265358979323846 / 180;

template <typename Model>
std::vector<double> numbers_of(const Model& model) {
  const auto p = model.parameters();
  return {p.begin(), p.end()};
}

template <typename Model>
Model with_numbers(const Model& model, const std::vector<double>& numbers) {
  auto p = model.parameters();
  std::copy_n(numbers.begin(), p.size(), p.begin());
  return Model::from_parameters(p);
}

// Focal lengths and principal point first, then numbers of the order of 1.
std::vector<double> usual_scales(size_t count, double focal) {
  std::vector<double> scales(count, 1.0);
  std::fill_n(scales.begin(), 4, focal);
  return scales;
}

}  // namespace

std::vector<ModelStart> model_starts(std::string_view model, double focal, const Eigen::Vector2d& axis) {
  const double f = focal, x = axis.x(), y = axis.y();
  std::vector<ModelStart> starts;
  const auto use = [&](const auto& m, double max_angle = 3.2) {
    starts.push_back({m, usual_scales(m.parameters().size(), f), max_angle});
  };
  if (model == Pinhole::kName) use(Pinhole{f, f, x, y}, kPerspectiveAngle);
  if (model == Radtan::kName) use(Radtan{f, f, x, y}, kPerspectiveAngle);
  if (model == Rational::kName) use(Rational{f, f, x, y}, kPerspectiveAngle);
  if (model == KannalaBrandt::kName) use(KannalaBrandt{f, f, x, y});
  if (model == Eucm::kName) use(Eucm{f, f, x, y, 0.5, 1});
  if (model == Equirectangular::kName) use(Equirectangular{f, f, x, y});
  if (model == Unified::kName) {
    for (const double xi : {0.5, 1.0, 1.5}) use(Unified{(1 + xi) * f, (1 + xi) * f, x, y, xi});
  }
  if (model == DoubleSphere::kName) {
    for (const double xi : {-0.2, 0.3}) use(DoubleSphere{(1 + xi) * f, (1 + xi) * f, x, y, xi, 0.55});
  }
  if (model == OCam::kName) {
    // Of the polynomial OCamCalib's five coefficients, a1 being zero; at first nearly equidistant.
    ModelStart start{OCam{x, y, 1, 0, 0, {f, 0, -1 / (3 * f)}},
                     std::vector<double>(OCam::kParameterNames.size(), 0.0)};
    const std::pair<size_t, double> free[] = {
        {0, f}, {1, f}, {2, 1}, {3, 1}, {4, 1}, {5, f}, {7, 1 / f}, {8, 1 / (f * f)}, {9, 1 / (f * f * f)}};
    for (const auto& [index, scale] : free) start.scales[index] = scale;
    starts.push_back(start);
  }
  return starts;
}

std::vector<double> model_numbers(const CameraModel& model) {
  return std::visit(
      [](const auto& m) -> std::vector<double> {
        if constexpr (ParametricModel<std::decay_t<decltype(m)>>) return numbers_of(m);
        return {};
      },
      model);
}

CameraModel with_model_numbers(const CameraModel& model, const std::vector<double>& numbers) {
  return std::visit(
      [&](const auto& m) -> CameraModel {
        if constexpr (ParametricModel<std::decay_t<decltype(m)>>) return with_numbers(m, numbers);
        return m;
      },
      model);
}

}  // namespace raysfm
