#include "raysfm/views/blindness.h"

#include <fmt/format.h>

#include <algorithm>

namespace raysfm {
namespace {

constexpr int kLeastCorners = 20;  // no pose comes from fewer
// Levels up to this are nearly black. Twelve bits in a file of sixteen end at 15.
constexpr int kBlack = 15;

int brightest_level(const View& view) {
  int level = 0;
  for (const CameraView& camera : view.cameras) {
    const GrayView image = camera.octaves->at(camera.octaves->first());
    for (int y = 0; y < image.height; ++y) {
      level = std::max<int>(level, *std::max_element(image.row(y), image.row(y) + image.width));
    }
  }
  return level;
}

}  // namespace

std::optional<std::string> blindness(const View& view) {
  int corners = 0;
  for (const CameraView& camera : view.cameras) corners += camera.features.size();
  if (corners >= kLeastCorners) return std::nullopt;
  std::string reason = fmt::format("too few corners: {}, at least {} are needed", corners, kLeastCorners);
  const int level = brightest_level(view);
  if (level <= kBlack) {
    reason += fmt::format("; the picture is nearly black, its brightest pixel is {} of 255", level);
  }
  return reason;
}

}  // namespace raysfm
