#pragma once

#include <filesystem>
#include <span>

#include "raysfm/core/result.h"
#include "raysfm/results/lens_file.h"

namespace raysfm {

// Draws a PNG: the focal length fx over time, at least one lens, with a band of two standard deviations to
// both sides.
Result<void> plot_lens(std::span<const LensOfFrame> lenses, const std::filesystem::path& path);

}  // namespace raysfm
