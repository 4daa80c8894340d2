#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "raysfm/lenses/point_tracks.h"
#include "raysfm/lenses/uncalibrated_scene.h"

namespace raysfm {

struct KnownStructureStartOptions {
  double max_error_px = 10;  // of an inlier; distortion, which the start does not know, is allowed for
  int max_samples = 1000;    // of each RANSAC
  uint64_t seed = 0;
  bool equal_lenses = true;
};

struct KnownStructureStart {
  UncalibratedScene scene;           // lenses with the principal point at the centre, square pixels, no skew
  std::vector<uint8_t> image_posed;  // one per image
  std::vector<uint8_t> inlier;       // one per observation
};

// Linear estimate of lenses and poses from points of known positions: from homographies where the points lie
// in a plane (Zhang 2000, 3.1, the principal point at the centre), else from views (direct linear transform).
// Nothing when the points lie on a line. Focal lengths that are not determined get a usual value.
std::optional<KnownStructureStart> known_structure_start(const PointTracks& tracks,
                                                         std::span<const Eigen::Vector3d> points,
                                                         const KnownStructureStartOptions& options);

}  // namespace raysfm
