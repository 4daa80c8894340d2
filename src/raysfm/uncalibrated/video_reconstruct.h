#pragma once

#include <cstdint>
#include <span>

#include "raysfm/core/result.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// As reconstruct(), for images in the order of time of which only some are key frames: a stretch of key
// frames is the start, the others are added one after the other, outward from it, with an adjustment in
// between; last, every other image is posed by the points that it sees, with its own focal length where the
// lens zooms. `keyframe`: one per image. `start_images` of the result are images of `tracks`.
// Errors: as reconstruct().
Result<UncalibratedReconstruction> reconstruct_video(const PointTracks& tracks,
                                                     std::span<const uint8_t> keyframe,
                                                     const SolveOptions& options);

}  // namespace raysfm
