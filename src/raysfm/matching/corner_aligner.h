#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/features/octaves.h"
#include "raysfm/features/patch_alignment.h"

namespace raysfm {

// Where patches of one image lie in another, to a few hundredths of a pixel, from rough places in both. How a
// patch is deformed follows from how its neighbours have moved.
class CornerAligner {
 public:
  // Element i of `out` belongs to places i, found in octaves[i] of the target; all spans have one length.
  // Measured in the finest octave that the place is seen in. A place that is not confirmed comes back with
  // converged = false. width, height: of both pictures, pixels.
  void align(const Octaves& base, std::span<const Eigen::Vector2f> in_base, const Octaves& target,
             std::span<const Eigen::Vector2f> in_target, std::span<const uint8_t> octaves, int width,
             int height, std::vector<PatchAlignment>* out);

 private:
  void deform(int width, int height, std::span<const Eigen::Vector2f> in_base,
              std::span<const Eigen::Vector2f> in_target);

  std::vector<Eigen::Matrix2f> base_from_target_;
};

}  // namespace raysfm
