#pragma once

#include <array>
#include <string_view>

#include "raysfm/camera/camera.h"
#include "raysfm/files/config_field.h"

namespace raysfm {

// How the file names RollingShutter::Direction, in its order.
constexpr std::array<std::string_view, 4> kShutterDirections = {"down", "up", "right", "left"};

// Reads the project's own camera file, `raysfm_camera: 1`. Every field is checked and unknown ones are
// refused; the first problem goes to root.problem() and the returned rig is to be ignored then.
Rig read_camera_yaml(const ConfigField& root);

}  // namespace raysfm
