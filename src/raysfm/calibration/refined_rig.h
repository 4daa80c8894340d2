#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/camera/camera.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// A rig that was refined, as what it was given as and what RigParameters of that became.
struct RefinedRig {
  Rig given;
  Eigen::VectorXd values;
};

// Of a rig that was refined as these numbers say. A readout stays as it is.
RefinedRig refined_rig(const Rig& refined, std::span<const CalibrationNumber> numbers);

}  // namespace raysfm
