#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "raysfm/uncalibrated/lens.h"
#include "raysfm/uncalibrated/uncalibrated_scene.h"

namespace raysfm {

// Names the motion or structure that leaves the lenses undetermined; empty when their standard deviations say
// that they are determined: half of the posed images know their focal length to better than 30 %. "pure
// rotation", "planar scene", "pure translation", "optical axes through one point", "parallel optical axes" or
// "undetermined" when none of these is seen. `sigma`, one per image, comes from the normal equations; the
// name from the scene.
std::string name_degeneracy(const UncalibratedScene& scene, std::span<const uint8_t> image_posed,
                            std::span<const uint8_t> point_placed, std::span<const LensVector> sigma);

}  // namespace raysfm
