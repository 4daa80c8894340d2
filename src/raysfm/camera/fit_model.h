#pragma once

#include <string_view>

#include "raysfm/camera/camera.h"
#include "raysfm/camera/fit_ray_table.h"
#include "raysfm/core/result.h"

namespace raysfm {

// The camera of another model that comes nearest to a camera: least squares of the distance, in pixels,
// between where the new model projects the rays of a regular grid of pixels and where they come from, by
// Levenberg-Marquardt from a start of equal focal length. All but the model is kept: resolution, pose, mask.
//
// `model` is the name of a central model that projects, e.g. "kannala-brandt"; "ray-table" is
// fit_ray_table(). A wide field does not fit into a perspective model: what the new model cannot project in
// its start, within 80 degrees of the axis for these, does not take part, and `samples` says how much did.
//
// kBadInput for other models, and where the camera's rays do not meet in one point.
Result<RayFit> fit_model(const Camera& camera, std::string_view model);

}  // namespace raysfm
