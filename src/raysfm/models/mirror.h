#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <string_view>

#include "raysfm/models/model.h"

namespace raysfm {

// Perspective camera that looks at a convex mirror of revolution, from anywhere: non-central. In the mirror's
// frame, its apex at the origin and its axis z away from the camera, the mirror is
//
//   x^2 + y^2 - 2 radius z + (1 + conic) z^2 = 0,  sqrt(x^2 + y^2) <= rim
//
// the sheet that holds the apex. conic 0 is a sphere, -1 a paraboloid, below -1 a hyperboloid.
// x_in_camera = rotation x_in_mirror + apex. The ray of a pixel starts where the perspective ray
// ((u - cx) / fx, (v - cy) / fy, 1) hits the mirror, and leaves as it is reflected there.
//
// A pixel sees nothing where it misses the mirror, and where the reflected ray meets the disc of radius
// `body` around the origin in the plane z = 0 of the camera's frame: there the camera sees itself. Lengths in
// the units of the rig, metres as a rule.
struct Mirror {
  static constexpr std::string_view kName = "mirror";
  static constexpr size_t kRequired = 14;
  static constexpr std::array<std::string_view, 15> kParameterNames = {"fx",
                                                                       "fy",
                                                                       "cx",
                                                                       "cy",
                                                                       "mirror.radius",
                                                                       "mirror.conic",
                                                                       "mirror.rim",
                                                                       "mirror.apex[0]",
                                                                       "mirror.apex[1]",
                                                                       "mirror.apex[2]",
                                                                       "mirror.rotation[0]",
                                                                       "mirror.rotation[1]",
                                                                       "mirror.rotation[2]",
                                                                       "mirror.rotation[3]",
                                                                       "mirror.body"};

  double fx = 1, fy = 1, cx = 0, cy = 0;
  double radius = 1, conic = 0, rim = 0.5;
  Eigen::Vector3d apex = Eigen::Vector3d::UnitZ();                 // in the camera's frame
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();          // camera from mirror
  Eigen::Quaterniond quaternion = Eigen::Quaterniond::Identity();  // the same, as given
  double body = 0;

  bool ray(const Eigen::Vector2d& pixel, Ray* ray) const;

  // Sizes that are not positive, a rim that the surface does not reach, a rotation that is none, a camera
  // that is not in front of the apex.
  std::optional<ParameterProblem> problem() const;

  std::array<double, 15> parameters() const;
  static Mirror from_parameters(const std::array<double, 15>& p);
};

static_assert(NonCentralModel<Mirror> && !CentralModel<Mirror> && !ProjectiveModel<Mirror>);

}  // namespace raysfm
