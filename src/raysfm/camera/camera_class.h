#pragma once

#include <string_view>

#include "raysfm/camera/camera.h"

namespace raysfm {

// How the rays of a rig lie in space. It decides which relative pose solvers apply and whether the scale of a
// motion can be observed.
enum class CameraClass {
  kCentral,     // all rays pass one point
  kAxial,       // several centres, all on one line: every ray of every camera meets that line
  kNonAxial,    // several centres, not on one line
  kNonCentral,  // the rays of one of the cameras do not meet in a point (a mirror, a slit)
};

// As in report.json: "central", "axial", "non-axial", "non-central".
std::string_view to_string(CameraClass camera_class);

// Measured on the rays of a coarse grid of pixels over every camera. A rig without any ray is central.
CameraClass camera_class(const Rig& rig);

}  // namespace raysfm
