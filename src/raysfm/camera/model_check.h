#pragma once

#include <optional>

#include "raysfm/camera/camera.h"
#include "raysfm/models/model.h"

namespace raysfm {

// The first parameter of a model that makes no camera, or nothing. Numbers that are not finite, focal lengths
// outside (0, 1e6] and principal points beyond 1e6 px, and what the model itself refuses. A model with a
// problem is safe to use, but its rays mean nothing.
std::optional<ParameterProblem> find_problem(const CameraModel& model);

}  // namespace raysfm
