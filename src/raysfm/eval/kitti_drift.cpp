#include "raysfm/eval/kitti_drift.h"

#include <algorithm>
#include <numbers>

namespace raysfm {

std::optional<KittiDrift> kitti_drift(std::span<const Rigid3> estimate, std::span<const Rigid3> truth,
                                      std::span<const double> path) {
  constexpr int kStep = 10;  // poses between the starts of stretches
  double translation = 0;    // sum of metres per metre
  double rotation = 0;       // sum of radians per metre
  int stretches = 0;
  for (size_t first = 0; first < path.size(); first += kStep) {
    for (double length = 100; length <= 800; length += 100) {
      const auto end = std::upper_bound(path.begin() + first, path.end(), path[first] + length);
      if (end == path.end()) break;
      const size_t last = end - path.begin();
      const Rigid3 true_motion = truth[first].inverse() * truth[last];
      const Rigid3 motion = estimate[first].inverse() * estimate[last];
      const Rigid3 error = motion.inverse() * true_motion;
      translation += error.translation.norm() / length;
      rotation += rotation_angle(error.rotation) / length;
      ++stretches;
    }
  }
  if (stretches == 0) return std::nullopt;
  const double degrees = 180.0 / std::numbers::pi;
  return KittiDrift{100.0 * translation / stretches, 100.0 * degrees * rotation / stretches, stretches};
}

}  // namespace raysfm
