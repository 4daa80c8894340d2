#pragma once

#include <array>
#include <filesystem>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// The lens with which a frame was taken: fx, fy, cx, cy, skew, and the standard deviation of each; pixels.
struct LensOfFrame {
  double timestamp = 0;  // seconds
  std::array<double, 5> value = {};
  std::array<double, 5> sigma = {};  // infinite where nothing is known
};

// Of the frames that have a pose and a lens of their own, a pinhole or radtan, in time order.
std::vector<LensOfFrame> lenses_of_frames(const Reconstruction& world);

// Writes `timestamp,fx,fy,cx,cy,skew,fx_sigma,fy_sigma,cx_sigma,cy_sigma,skew_sigma`, one line for each of
// these, rounded to a millionth of a pixel; report.json has all digits.
Result<void> write_lens_file(const Reconstruction& world, const std::filesystem::path& path);

}  // namespace raysfm
