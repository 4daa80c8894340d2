#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/core/result.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// Fewest points of an image that give its homography or its view, outliers allowed for.
inline constexpr int kMinKnownPoints = 6;

// Lenses and poses where the positions of the points are known, such as the corners of a board (Zhang 2000):
// homographies of a plane, or views of points in space, to a linear estimate of the focal lengths, then
// adjustment of poses and lenses. A lens that is the same in all images has a radial distortion too. The
// world is that of `points`, one for each point of the tracks; `method` and `constraints` of the options are
// not read. kBadInput for tracks that contradict themselves or positions that do not fit them;
// kNoReconstruction with the reason.
Result<UncalibratedReconstruction> reconstruct_known(const PointTracks& tracks,
                                                     std::span<const Eigen::Vector3d> points,
                                                     const SolveOptions& options);

}  // namespace raysfm
