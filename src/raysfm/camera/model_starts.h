#pragma once

#include <Eigen/Core>
#include <string_view>
#include <vector>

#include "raysfm/camera/camera.h"

namespace raysfm {

// Where a fit of a model starts: a camera with no more than a focal length, and which of its numbers are to
// be found.
struct ModelStart {
  CameraModel model;
  std::vector<double> scales;  // of each number: how much of it matters; 0: stays as it is
  double max_angle = 3.2;      // radians off the axis; rays beyond take no part
};

// The models that have one, for messages.
inline constexpr std::string_view kModelsWithStart =
    "pinhole, radtan, rational, kannala-brandt, unified, double-sphere, eucm, ocam, equirectangular";

// Starts of the model of a name; `focal` is in pixels per radian on the axis, which is at the pixel `axis`.
// None where the model is not one that can be fitted, several where there are several minima.
std::vector<ModelStart> model_starts(std::string_view model, double focal, const Eigen::Vector2d& axis);

// The numbers of a model in the order of its kParameterNames; none for a table.
std::vector<double> model_numbers(const CameraModel& model);

// The model with other numbers, as many as it has; a table stays as it is.
CameraModel with_model_numbers(const CameraModel& model, const std::vector<double>& numbers);

}  // namespace raysfm
