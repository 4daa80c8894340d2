#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "raysfm/lenses/lens.h"
#include "raysfm/lenses/uncalibrated_scene.h"

namespace raysfm {

// Whether the standard deviations `sigma`, one per lens, tell the focal length of more than half of the
// lenses to better than 30 %.
bool focal_lengths_are_known(std::span<const Lens> lenses, std::span<const LensVector> sigma);

// Names the motion or structure that leaves the lenses or the structure undetermined; empty when they are
// determined. Critical whatever the lens are "pure rotation" (half of the points are seen under less than
// 0.01 rad of parallax), "pure translation" and "parallel optical axes". Otherwise the standard deviations
// `sigma`, one per image, from the spectrum of the normal equations decide: unless
// focal_lengths_are_known(), it is "planar scene", "optical axes through one point", or "undetermined" when
// none of these is seen.
std::string name_degeneracy(const UncalibratedScene& scene, std::span<const uint8_t> image_posed,
                            std::span<const uint8_t> point_placed, std::span<const LensVector> sigma);

}  // namespace raysfm
