#pragma once

#include <Eigen/Core>

#include "raysfm/core/random.h"

namespace raysfm::testing_support {

// N(0, 1) along each axis.
inline Eigen::Vector3d normal_vector(Rng& rng) {
  return {rng.normal(), rng.normal(), rng.normal()};
}

}  // namespace raysfm::testing_support
