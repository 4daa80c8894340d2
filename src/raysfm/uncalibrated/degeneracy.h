#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "raysfm/uncalibrated/lens.h"
#include "raysfm/uncalibrated/uncalibrated_scene.h"

namespace raysfm {

// Names the motion or structure that leaves the lenses undetermined; empty when they are determined. "pure
// translation" and "parallel optical axes" are critical whatever the lens. Otherwise the standard deviations
// `sigma`, one per image, from the normal equations decide: when not half of the posed images know their
// focal length to better than 30 %, it is "pure rotation", "planar scene", "optical axes through one point",
// or "undetermined" when none of these is seen.
std::string name_degeneracy(const UncalibratedScene& scene, std::span<const uint8_t> image_posed,
                            std::span<const uint8_t> point_placed, std::span<const LensVector> sigma);

}  // namespace raysfm
