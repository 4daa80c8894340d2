#pragma once

#include <Eigen/Core>

#include "raysfm/bundle/bundle_core.h"

namespace raysfm {

// The directions in which a state can move without any observation seeing it.
struct Gauge {
  Eigen::MatrixXd poses;   // N rows for each free pose, as in the system; one column for each direction
  Eigen::MatrixXd points;  // three rows for each free point
  int directions() const { return static_cast<int>(poses.cols()); }
};

// Of translation, rotation and scale of the world, what neither a fixed pose or point nor an observation
// holds, from the normal equations as linearised at the problem's state.
template <int N>
Gauge find_gauge(const BundleProblem& problem, const ObservationLayout& layout, const SchurSystem<N>& system);

extern template Gauge find_gauge<6>(const BundleProblem&, const ObservationLayout&, const SchurSystem<6>&);
extern template Gauge find_gauge<9>(const BundleProblem&, const ObservationLayout&, const SchurSystem<9>&);

}  // namespace raysfm
