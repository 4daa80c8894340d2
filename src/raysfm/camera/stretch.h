#pragma once

#include "raysfm/camera/camera.h"

namespace raysfm {

// Makes a camera that of its images stretched so many times in width: each point of them sees what it saw.
// The size of the images is left to the caller. False, and nothing changed, where the model has no focal
// length in x.
bool stretch(double factor, Camera* camera);

}  // namespace raysfm
