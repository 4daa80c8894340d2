#pragma once

#include <cstdint>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/projective/view_pair.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// A metric scene of a part of the images and points.
struct GrowingScene {
  UncalibratedScene scene;            // of all images and points; what is not posed or placed means nothing
  std::vector<uint8_t> image_posed;   // one per image
  std::vector<uint8_t> point_placed;  // one per point

  int posed() const;
};

// Two images and what they share, seen with lenses of this focal length: from five of the inliers of the pair
// (in pixels), or from its fundamental matrix, whichever more agree with. False where that puts hardly a
// point in front of both.
bool euclidean_start(const PointTracks& tracks, const ViewPair& pair, double focal,
                     const SolveOptions& options, GrowingScene* scene);

// Points that two or more posed images see under more than about a degree, and that agree with more than half
// of them.
void place_left_points(const PointTracks& tracks, double max_error_px, GrowingScene* scene);

// Poses of images that are left, by the points placed: with the lens of the others, or, where lenses zoom,
// with that of one of them and focal lengths about it. Points are placed in between. Returns how many were
// posed.
int pose_left_images(const PointTracks& tracks, const SolveOptions& options, bool zooming,
                     GrowingScene* scene);

}  // namespace raysfm
