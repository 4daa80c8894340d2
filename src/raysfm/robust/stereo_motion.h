#pragma once

#include <vector>

#include "raysfm/robust/generic_start.h"
#include "raysfm/robust/rig_table.h"

namespace raysfm {

// Motion over three views from points that several cameras see at the instant of view 0: they are
// triangulated there, and views 1 and 2 get their poses from them (PoseEstimator). `inliers`: points of the
// table that fit in all views. False where fewer than options.min_inliers can be triangulated or a pose
// fails.
bool motion_from_stereo_points(const RigTable& table, const GenericStartOptions& options, RigMotion* motion,
                               std::vector<int>* inliers);

}  // namespace raysfm
