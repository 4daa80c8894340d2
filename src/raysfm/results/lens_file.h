#pragma once

#include <array>
#include <filesystem>
#include <span>

#include "raysfm/core/result.h"

namespace raysfm {

// The lens with which a frame was taken: fx, fy, cx, cy, skew, and the standard deviation of each; pixels.
struct LensOfFrame {
  double timestamp = 0;  // seconds
  std::array<double, 5> value = {};
  std::array<double, 5> sigma = {};  // infinite where nothing is known
};

// Writes `timestamp,fx,fy,cx,cy,skew,fx_sigma,fy_sigma,cx_sigma,cy_sigma,skew_sigma`, one line for each.
Result<void> write_lens_file(std::span<const LensOfFrame> lenses, const std::filesystem::path& path);

}  // namespace raysfm
