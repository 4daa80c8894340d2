#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/geometry/pose.h"
#include "raysfm/lenses/lens.h"

namespace raysfm {

struct LensResectionOptions {
  double max_error_px = 3.0;  // of an inlier, > 0
  bool zooming = false;       // the focal length is found, and the principal point near the given one
  // Standard deviation of the principal point about that of the given lens, pixels, > 0.
  double principal_point_sigma_px = 5.0;
  int min_inliers = 12;
  uint64_t seed = 0;
  uint64_t stream = 0;
};

// Pose and lens of one image of known points.
struct LensResection {
  Rigid3 cam_from_world;
  Lens lens;
  LensVector lens_sigma = LensVector::Zero();  // infinite for a lens that was not estimated
  std::vector<uint8_t> inlier;                 // one per observation
  int inlier_count = 0;
};

// Pose, and for a lens that zooms its focal length and principal point, of a view of known points near a view
// of known pose and lens: RANSAC over poses with the given lens, then Levenberg-Marquardt over all numbers.
// `points` in the world and `pixels` have one length. False when fewer than min_inliers agree.
bool resect_with_lens(std::span<const Eigen::Vector3d> points, std::span<const Eigen::Vector2d> pixels,
                      const Rigid3& near_cam_from_world, const Lens& near_lens,
                      const LensResectionOptions& options, LensResection* result);

}  // namespace raysfm
