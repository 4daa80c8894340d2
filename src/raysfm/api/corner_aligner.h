#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/features/patch_alignment.h"

namespace raysfm {

// Where patches of one image lie in another, to a few hundredths of a pixel, from rough places in both. How a
// patch is deformed follows from how its neighbours have moved.
class CornerAligner {
 public:
  // Element i of `out` belongs to places i; all spans have one length. A place that is not confirmed comes
  // back with converged = false.
  void align(const GrayView& base, std::span<const Eigen::Vector2f> in_base, const GrayView& target,
             std::span<const Eigen::Vector2f> in_target, std::vector<PatchAlignment>* out);

 private:
  void deform(const GrayView& base, std::span<const Eigen::Vector2f> in_base,
              std::span<const Eigen::Vector2f> in_target);

  std::vector<Eigen::Matrix2f> base_from_target_;
};

}  // namespace raysfm
