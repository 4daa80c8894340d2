#pragma once

#include "raysfm/core/result.h"
#include "raysfm/lenses/lens_adjustment.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/lenses/uncalibrated_scene.h"

namespace raysfm {

// One instant of a moving, deforming set of points that several cameras follow while they move and zoom
// (IFBA01 4.4.3 and 5.1.3): adjust_polished() from where the last instant ended. An image of `tracks` is a
// camera, in the same order at every instant, a point the same point.
//
// `scene` is that of the last instant and becomes that of this one. What this instant does not show keeps its
// place. A point whose position is not finite is new: it is placed where the cameras of the last instant see
// it, or left out where fewer than two do. World frame and scale are free at every instant, and move by no
// more than the adjustment does. An error leaves `scene` alone; those of adjust_polished(), and kBadInput for
// a scene of other sizes than the tracks.
Result<LensAdjustmentSummary> adjust_next_instant(const PointTracks& tracks,
                                                  const LensAdjustmentOptions& options,
                                                  UncalibratedScene* scene);

}  // namespace raysfm
