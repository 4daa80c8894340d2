#pragma once

#include "raysfm/camera/camera.h"

namespace raysfm {

// Makes a camera that of its images stretched so many times in width and in height (> 0): each point of them
// sees what it saw. The size of the images is left to the caller. False, and nothing changed, where the model
// has no focal lengths.
bool stretch(const Eigen::Vector2d& factors, Camera* camera);

}  // namespace raysfm
