#include "raysfm/io/colmap_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace raysfm {
namespace {

constexpr double kPixelOrigin = 0.5;  // COLMAP: the corner of the top-left pixel is (0, 0)

enum : int32_t {
  kSimplePinhole = 0,
  kPinhole = 1,
  kSimpleRadial = 2,
  kRadial = 3,
  kOpenCv = 4,
  kFullOpenCv = 6,
};

constexpr ColmapCameraModel kModels[] = {
    {kSimplePinhole, "SIMPLE_PINHOLE", 3},
    {kPinhole, "PINHOLE", 4},
    {kSimpleRadial, "SIMPLE_RADIAL", 4},
    {kRadial, "RADIAL", 5},
    {kOpenCv, "OPENCV", 8},
    {5, "OPENCV_FISHEYE", 8},
    {kFullOpenCv, "FULL_OPENCV", 12},
    {7, "FOV", 5},
    {8, "SIMPLE_RADIAL_FISHEYE", 4},
    {9, "RADIAL_FISHEYE", 5},
    {10, "THIN_PRISM_FISHEYE", 12},
    {11, "RAD_TAN_THIN_PRISM_FISHEYE", 16},
    {12, "SIMPLE_DIVISION", 4},
    {13, "DIVISION", 5},
    {14, "SIMPLE_FISHEYE", 3},
    {15, "FISHEYE", 4},
    {16, "EUCM", 6},
    {17, "EQUIRECTANGULAR", 2},
};

// The parameters with one focal length for each axis.
std::vector<double> with_two_focal_lengths(int32_t model, std::span<const double> parameters) {
  std::vector<double> p(parameters.begin(), parameters.end());
  if (model == kSimplePinhole || model == kSimpleRadial || model == kRadial) p.insert(p.begin(), p.front());
  return p;
}

ColmapCamera to_colmap(const Pinhole& m) {
  return {.model = kPinhole, .parameters = {m.fx, m.fy, m.cx, m.cy}};
}

ColmapCamera to_colmap(const Radtan& m) {
  ColmapCamera camera{.model = kOpenCv, .parameters = {m.fx, m.fy, m.cx, m.cy, m.k1, m.k2, m.p1, m.p2}};
  if (m.k3 != 0) {
    camera.model = kFullOpenCv;
    camera.parameters.insert(camera.parameters.end(), {m.k3, 0, 0, 0});
  }
  return camera;
}

ColmapCamera to_colmap(const Rational& m) {
  return {.model = kFullOpenCv,
          .parameters = {m.fx, m.fy, m.cx, m.cy, m.k1, m.k2, m.p1, m.p2, m.k3, m.k4, m.k5, m.k6}};
}

template <typename Model>
concept KnownToColmap = requires(const Model& model) {
  to_colmap(model);
};

}  // namespace

const ColmapCameraModel* find_colmap_model(int32_t id) {
  const auto* model = std::ranges::find(kModels, id, &ColmapCameraModel::id);
  return model == std::end(kModels) ? nullptr : model;
}

const ColmapCameraModel* find_colmap_model(std::string_view name) {
  const auto* model = std::ranges::find(kModels, name, &ColmapCameraModel::name);
  return model == std::end(kModels) ? nullptr : model;
}

std::string colmap_model_names() {
  std::string names;
  for (const ColmapCameraModel& model : kModels) {
    names += (names.empty() ? "" : ", ") + std::string(model.name);
  }
  return names;
}

Result<CameraModel> camera_model_from_colmap(int32_t model, std::span<const double> parameters) {
  const ColmapCameraModel* known = find_colmap_model(model);
  if (!known || parameters.size() != known->parameters) {
    return bad_input(fmt::format("model {} with {} numbers is not allowed", model, parameters.size()));
  }
  std::vector<double> p = with_two_focal_lengths(model, parameters);
  const bool finite = std::ranges::all_of(p, [](double number) { return std::isfinite(number); });
  if (!finite || !(p[0] > 0) || !(p[1] > 0)) {
    return bad_input(fmt::format("{} with focal lengths {}, {} is not allowed, finite numbers above 0 are",
                                 known->name, p[0], p[1]));
  }
  p[2] -= kPixelOrigin;
  p[3] -= kPixelOrigin;
  switch (model) {
    case kSimplePinhole:
    case kPinhole:
      return CameraModel(Pinhole{p[0], p[1], p[2], p[3]});
    case kSimpleRadial:
      return CameraModel(Radtan{p[0], p[1], p[2], p[3], p[4]});
    case kRadial:
      return CameraModel(Radtan{p[0], p[1], p[2], p[3], p[4], p[5]});
    case kOpenCv:
      return CameraModel(Radtan{p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]});
    case kFullOpenCv:
      return CameraModel(Rational{p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11]});
    default:
      return bad_input(
          fmt::format("{} has no counterpart here; SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, "
                      "OPENCV and FULL_OPENCV have",
                      known->name));
  }
}

std::optional<ColmapCamera> colmap_camera(const CameraModel& model) {
  return std::visit(
      []<typename Model>(const Model& m) -> std::optional<ColmapCamera> {
        if constexpr (KnownToColmap<Model>) {
          ColmapCamera camera = to_colmap(m);
          camera.parameters[2] += kPixelOrigin;
          camera.parameters[3] += kPixelOrigin;
          return camera;
        } else {
          return std::nullopt;
        }
      },
      model);
}

}  // namespace raysfm
