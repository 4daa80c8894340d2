#include "raysfm/camera_files/colmap_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "raysfm/camera_files/camera_import.h"

namespace raysfm {
namespace {

enum : int32_t {
  kSimplePinhole = 0,
  kPinhole = 1,
  kSimpleRadial = 2,
  kRadial = 3,
  kOpenCv = 4,
  kOpenCvFisheye = 5,
  kFullOpenCv = 6,
  kSimpleRadialFisheye = 8,
  kRadialFisheye = 9,
  kThinPrismFisheye = 10,
  kSimpleDivision = 12,
  kDivision = 13,
  kSimpleFisheye = 14,
  kFisheye = 15,
  kEucm = 16,
  kEquirectangular = 17,
};

constexpr ColmapCameraModel kModels[] = {
    {kSimplePinhole, "SIMPLE_PINHOLE", 3},
    {kPinhole, "PINHOLE", 4},
    {kSimpleRadial, "SIMPLE_RADIAL", 4},
    {kRadial, "RADIAL", 5},
    {kOpenCv, "OPENCV", 8},
    {kOpenCvFisheye, "OPENCV_FISHEYE", 8},
    {kFullOpenCv, "FULL_OPENCV", 12},
    {7, "FOV", 5},
    {kSimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", 4},
    {kRadialFisheye, "RADIAL_FISHEYE", 5},
    {kThinPrismFisheye, "THIN_PRISM_FISHEYE", 12},
    {11, "RAD_TAN_THIN_PRISM_FISHEYE", 16},
    {kSimpleDivision, "SIMPLE_DIVISION", 4},
    {kDivision, "DIVISION", 5},
    {kSimpleFisheye, "SIMPLE_FISHEYE", 3},
    {kFisheye, "FISHEYE", 4},
    {kEucm, "EUCM", 6},
    {kEquirectangular, "EQUIRECTANGULAR", 2},
};

// The parameters with one focal length for each axis.
std::vector<double> with_two_focal_lengths(int32_t model, std::span<const double> parameters) {
  std::vector<double> p(parameters.begin(), parameters.end());
  constexpr int32_t kOneFocalLength[] = {kSimplePinhole, kSimpleRadial,  kRadial,        kSimpleRadialFisheye,
                                         kRadialFisheye, kSimpleFisheye, kSimpleDivision};
  if (std::ranges::find(kOneFocalLength, model) != std::end(kOneFocalLength)) p.insert(p.begin(), p.front());
  return p;
}

// A panorama over the whole image, of which the parameters are width and height.
Result<CameraModel> equirectangular(std::span<const double> size) {
  constexpr double kLargest = 1e6;
  if (!(size[0] >= 1 && size[0] <= kLargest && size[1] >= 1 && size[1] <= kLargest)) {
    return bad_input(
        fmt::format("EQUIRECTANGULAR of {} x {} is not allowed, 1 to 1e6 are", size[0], size[1]));
  }
  return CameraModel(Equirectangular::for_image(static_cast<int>(size[0]), static_cast<int>(size[1])));
}

// k1 k2 p1 p2 k3 k4 sx1 sy1 behind fx fy cx cy: Kannala-Brandt where nothing tangential is in it.
std::optional<CameraModel> thin_prism_fisheye(const std::vector<double>& p) {
  if (p[6] != 0 || p[7] != 0 || p[10] != 0 || p[11] != 0) return std::nullopt;
  return KannalaBrandt{p[0], p[1], p[2], p[3], p[4], p[5], p[8], p[9]};
}

// Models other than the perspective ones; nullopt where the project has none.
std::optional<CameraModel> wide_model(int32_t model, const std::vector<double>& p) {
  switch (model) {
    case kSimpleFisheye:
    case kFisheye:
    case kSimpleRadialFisheye:
    case kRadialFisheye:
    case kOpenCvFisheye:
      return model_from<KannalaBrandt>(p);
    case kThinPrismFisheye:
      return thin_prism_fisheye(p);
    case kSimpleDivision:
    case kDivision:
      return division_model(p[0], p[1], p[2], p[3], p[4]);
    case kEucm:
      return model_from<Eucm>(p);
    default:
      return std::nullopt;
  }
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

ColmapCamera to_colmap(const KannalaBrandt& m) {
  return {.model = kOpenCvFisheye, .parameters = {m.fx, m.fy, m.cx, m.cy, m.k1, m.k2, m.k3, m.k4}};
}

ColmapCamera to_colmap(const Eucm& m) {
  return {.model = kEucm, .parameters = {m.fx, m.fy, m.cx, m.cy, m.alpha, m.beta}};
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
  if (model == kEquirectangular) return equirectangular(parameters);
  std::vector<double> p = with_two_focal_lengths(model, parameters);
  const bool finite = std::ranges::all_of(p, [](double number) { return std::isfinite(number); });
  if (!finite || !(p[0] > 0) || !(p[1] > 0)) {
    return bad_input(fmt::format("{} with focal lengths {}, {} is not allowed, finite numbers above 0 are",
                                 known->name, p[0], p[1]));
  }
  p[2] -= kColmapPixelOrigin;
  p[3] -= kColmapPixelOrigin;
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
      break;
  }
  const std::optional<CameraModel> wide = wide_model(model, p);
  if (wide) return *wide;
  return bad_input(fmt::format("{} has no counterpart here with these parameters; the others of {} have",
                               known->name, colmap_model_names()));
}

std::optional<ColmapCamera> colmap_camera(const CameraModel& model) {
  return std::visit(
      []<typename Model>(const Model& m) -> std::optional<ColmapCamera> {
        if constexpr (KnownToColmap<Model>) {
          ColmapCamera camera = to_colmap(m);
          camera.parameters[2] += kColmapPixelOrigin;
          camera.parameters[3] += kColmapPixelOrigin;
          return camera;
        } else {
          return std::nullopt;
        }
      },
      model);
}

}  // namespace raysfm
