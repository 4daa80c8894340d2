#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/exports/export_scene.h"
#include "raysfm/image/image.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Where the images of a reconstruction are found again.
struct ImageInput {
  std::vector<std::string> paths;  // as `track` or `solve` was given them; of `adjust`, one folder
  Rig cameras;      // tell the stream, or the part of one, of each camera by its name; may be empty
  int threads = 0;  // of the decoder of a video; 0: as many as the machine has
};

// What is done with image `i` of a scene: blue, green and red of a pixel side by side, of the part of the
// frame that is the camera's. An error ends the reading.
using SceneImageVisitor = std::function<Result<void>(size_t i, const Image<uint8_t>& bgr)>;

// Reads every frame of `input` that the scene has images of and hands these over in the order of the scene.
// Errors: those of `visit`; bad input, where frames are missing, damaged, of another size or of other names.
Result<void> visit_images(const ImageInput& input, const Reconstruction& world, const ExportScene& scene,
                          const SceneImageVisitor& visit);

}  // namespace raysfm
