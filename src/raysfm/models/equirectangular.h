#pragma once

#include <Eigen/Core>
#include <array>
#include <string_view>

#include "raysfm/models/model.h"

namespace raysfm {

// Panorama: longitude and latitude (COLMAP's EQUIRECTANGULAR).
//
//   u = cx + fx atan2(x, z),  v = cy + fy asin(y / |(x, y, z)|)
//
// fx and fy are pixels per radian, (cx, cy) the pixel of the z axis. for_image() is the full sphere over an
// image.
//
// The seam is the half plane x = 0, z < 0: project() gives the longitude in [-pi, pi], so a point that
// crosses the seam jumps by 2 pi fx pixels. Pixels beyond the seam, up to a longitude of 2 pi, see what the
// pixel 2 pi fx away sees: their ray is given, but project() leads back to that other pixel. Valid set: all
// but the poles, with some 1e-6 rad around them, where every longitude meets.
struct Equirectangular {
  static constexpr std::string_view kName = "equirectangular";
  static constexpr size_t kRequired = 0;
  static constexpr std::array<std::string_view, 4> kParameterNames = {"fx", "fy", "cx", "cy"};

  double fx = 1, fy = 1, cx = 0, cy = 0;

  bool project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;
  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const;

  // Width and height in pixels.
  static Equirectangular for_image(int width, int height);

  std::array<double, 4> parameters() const { return {fx, fy, cx, cy}; }
  static Equirectangular from_parameters(const std::array<double, 4>& p) { return {p[0], p[1], p[2], p[3]}; }
};

static_assert(CentralModel<Equirectangular> && ProjectiveModel<Equirectangular>);

}  // namespace raysfm
