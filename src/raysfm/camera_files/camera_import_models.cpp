// What several formats share: models written in another way than the project's own.
#include <fmt/format.h>

#include <Eigen/QR>
#include <array>
#include <cmath>
#include <numbers>

#include "raysfm/camera_files/camera_import.h"

namespace raysfm {

CameraModel perspective_model(const std::vector<double>& numbers) {
  std::array<double, 12> p{};
  std::copy_n(numbers.begin(), std::min(numbers.size(), p.size()), p.begin());
  const auto zero_from = [&](size_t first) {
    return std::all_of(p.begin() + first, p.end(), [](double v) { return v == 0; });
  };
  if (zero_from(4)) return Pinhole{p[0], p[1], p[2], p[3]};
  if (zero_from(9)) return Radtan{p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]};
  return Rational::from_parameters(p);
}

std::optional<CameraModel> division_model(double fx, double fy, double cx, double cy, double k) {
  if (k == 0) return Pinhole{fx, fy, cx, cy};
  if (!(k < 0)) return std::nullopt;
  return Eucm{fx, fy, cx, cy, 0.5, -4 * k};
}

namespace {

// Largest angle off the axis that the FOV model sees inside an image, below 89.5 degrees.
double fov_reach(const std::vector<double>& p, int width, int height) {
  constexpr double kLargest = 89.5 * std::numbers::pi / 180;
  if (width == 0) return kLargest;
  double radius = 0;
  for (const double u : {0.0, width - 1.0}) {
    for (const double v : {0.0, height - 1.0}) {
      radius = std::max(radius, std::hypot((u - p[2]) / p[0], (v - p[3]) / p[1]));
    }
  }
  const double argument = radius * p[4];
  if (!(argument < 0.5 * std::numbers::pi)) return kLargest;
  return std::min(kLargest, std::atan(std::tan(argument) / (2 * std::tan(0.5 * p[4]))));
}

}  // namespace

CameraModel fov_model(const std::vector<double>& p, int width, int height, const ConfigField& field,
                      std::string* note) {
  const double omega = p[4];
  if (!(omega > 0 && omega < std::numbers::pi) || !(p[0] > 0 && p[1] > 0)) {
    field.problem().report(field.name(), fmt::format("omega {}, focal lengths {}, {}", omega, p[0], p[1]),
                           "omega between 0 and pi, focal lengths above 0");
    return Pinhole{};
  }
  constexpr int kSamples = 200;
  const double reach = fov_reach(p, width, height);
  Eigen::Matrix<double, kSamples, 5> powers;  // theta, theta^3, ... theta^9
  Eigen::Matrix<double, kSamples, 1> radius;  // in units of the focal length
  for (int i = 0; i < kSamples; ++i) {
    const double theta = reach * (i + 1) / kSamples;
    radius(i) = std::atan(2 * std::tan(theta) * std::tan(0.5 * omega)) / omega;
    for (int j = 0; j < 5; ++j) powers(i, j) = std::pow(theta, 2 * j + 1);
  }
  const Eigen::Matrix<double, 5, 1> s = powers.colPivHouseholderQr().solve(radius);
  const double error = (powers * s - radius).cwiseAbs().maxCoeff() * std::max(p[0], p[1]);
  if (!s.allFinite() || !(s(0) > 0)) {
    field.problem().report(field.name(), fmt::format("omega {}", omega),
                           "a FOV model that Kannala-Brandt can follow");
    return Pinhole{};
  }
  add_note(note,
           fmt::format("FOV model read as a fitted kannala-brandt, which differs by up to {:.2g} px", error));
  return KannalaBrandt::from_parameters(
      {p[0] * s(0), p[1] * s(0), p[2], p[3], s(1) / s(0), s(2) / s(0), s(3) / s(0), s(4) / s(0)});
}

void read_resolution(const ConfigField& field, Camera* camera) {
  const std::vector<ConfigField> sides = field.list();
  if (sides.size() != 2) return field.report("[width, height]");
  camera->width = sides[0].integer(1, kMaxImageSide);
  camera->height = sides[1].integer(1, kMaxImageSide);
}

void add_note(std::string* note, const std::string& text) {
  if (note->find(text) != std::string::npos) return;  // the same of several cameras is said once
  *note += (note->empty() ? "" : "; ") + text;
}

}  // namespace raysfm
