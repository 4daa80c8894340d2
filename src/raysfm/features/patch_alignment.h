#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/image/image.h"

namespace raysfm {

// Where a patch was found.
struct PatchAlignment {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  // in the target image; the start where not converged
  float zncc = 0;                                   // of the aligned patches, in [-1, 1]
  bool converged = false;
};

// When an alignment has converged, and when it has gone astray.
struct PatchAlignmentOptions {
  int max_iterations = 10;
  float stop_px = 0.02f;      // converged when a step is shorter than this
  float max_shift_px = 3.0f;  // from the start; farther ones are rejected
  float min_zncc = 0.7f;      // lower ones are rejected
};

// Finds where patches of a reference image lie in a target image, to a few hundredths of a pixel: inverse
// compositional Lucas-Kanade over the two coordinates of a patch of 11 x 11 pixels, with gain and bias of the
// brightness projected out (Baker and Matthews, Lucas-Kanade 20 Years On, 2004).
class PatchAligner {
 public:
  PatchAligner() = default;
  explicit PatchAligner(const PatchAlignmentOptions& options) : options_(options) {}

  // All spans have the same size. Offset o in the target patch belongs to reference_pixels[i] +
  // reference_from_target[i] * o in the reference. Rejected, with converged = false: a patch that leaves its
  // image, has no texture in some direction, moves too far, or does not look alike in the end.
  void align(const GrayView& reference, std::span<const Eigen::Vector2f> reference_pixels,
             std::span<const Eigen::Matrix2f> reference_from_target, const GrayView& target,
             std::span<const Eigen::Vector2f> initial, std::span<PatchAlignment> out) const;

 private:
  PatchAlignmentOptions options_;
};

}  // namespace raysfm
