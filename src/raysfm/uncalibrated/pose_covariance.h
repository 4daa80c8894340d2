#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/lenses/point_tracks.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// One per image: the covariance of the tangent (v, w) of its cam_from_world, see retract(), from its inliers;
// the points are held fixed, and so is the lens unless it zooms. Zero without a pose, infinite where the
// inliers do not determine it.
std::vector<Eigen::Matrix<double, 6, 6>> pose_covariances(const PointTracks& tracks,
                                                          const UncalibratedReconstruction& found);

}  // namespace raysfm
