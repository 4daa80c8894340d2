#pragma once

#include <cstdint>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/projective/projective_adjustment.h"

namespace raysfm {

struct ProjectiveStartOptions {
  double max_error = 0.005;  // of an inlier, in the units of the pixels
  int max_samples = 2000;    // of each RANSAC
  uint64_t seed = 0;
  int rank = 0;                                // of the pair to start from, see farthest_pair()
  const ProgressCallback* progress = nullptr;  // null or empty: none; false ends without a start
};

// Projective reconstruction of all images that can be registered.
struct ProjectiveStart {
  ProjectiveScene scene;              // one view for each image, one point for each point
  std::vector<uint8_t> image_posed;   // one per image
  std::vector<uint8_t> point_placed;  // one per point
  std::vector<uint8_t> inlier;        // one per observation
  int images[2] = {-1, -1};           // the pair of the start
  int pair_inliers = 0;
};

// IFBA01 4.2: F between the two views farthest apart by what no homography explains, triangulation, resection
// of the others by the number of points they see, adjustment in between. The pixels of `tracks` are near
// unit size about the centre of the image. kNoReconstruction with the reason: too few matches, or no pair
// that is not related by a homography (pure rotation or a planar scene).
Result<ProjectiveStart> projective_start(const PointTracks& tracks, const ProjectiveStartOptions& options);

}  // namespace raysfm
