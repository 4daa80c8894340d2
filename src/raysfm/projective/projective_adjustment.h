#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/lenses/observation_index.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/optim/robust_loss.h"
#include "raysfm/projective/optimal_triangulation.h"

namespace raysfm {

// Views and points up to one projective map of space. Both up to scale, kept at unit length.
struct ProjectiveScene {
  std::vector<Matrix34d> views;
  std::vector<Eigen::Vector4d> points;
};

// Bundle adjustment in projective space with the fewest parameters (IFBA01 4.2 and its reference 1): 11 for a
// view and 3 for a point, on the spheres of unit vectors; the 15 free directions are left to the damping.
// `scene` has the indexed images and points. The units of the loss are those of the pixels.
LmSummary adjust_projective(const ObservationIndex& index, const RobustLoss& loss, const LmOptions& options,
                            ProjectiveScene* scene);

}  // namespace raysfm
