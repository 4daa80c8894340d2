#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"

namespace raysfm {

// Numbers of control points of a ray table.
struct TableGrid {
  int width = 0, height = 0;
};

// What a camera may become.
struct ModelChoice {
  std::string model;  // name; empty: any that the format holds
  bool fit = false;   // the nearest camera will do where no formula leads to the model
  std::optional<TableGrid> grid = std::nullopt;  // of a ray table; nullopt: as the camera needs it
};

// Brings the camera to a model that the format (camera_formats()) holds, by formula where there is one. The
// value is a line that says how far off a fitted model is; empty where the rays stay as they are. Errors: bad
// input, naming the camera.
Result<std::string> bring_to_format(std::string_view format, const ModelChoice& choice, Camera* camera);

}  // namespace raysfm
