#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "raysfm/bundle/bundle_methods.h"

namespace raysfm {

// A problem in the form of Bundle Adjustment in the Large (Agarwal et al. 2010). Nine numbers for each
// camera: the rotation vector (radians) and the translation of cam_from_world, then f, k1, k2 (BalLens).
// Pixels are counted from the principal point, x to the right, y up; cameras look along -z.
struct BalProblem {
  struct Observation {
    int camera = 0;
    int point = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  };
  std::vector<std::array<double, 9>> cameras;
  std::vector<Eigen::Vector3d> points;
  std::vector<Observation> observations;
};

// Refines all cameras and points in place by the method. Observations of points behind their camera are
// dropped and counted. kInvalidProblem, and nothing is changed, where an index is out of range.
// options.progress is called as BundleOptions says.
BundleSummary adjust_bal(BalProblem* problem, BundleMethod method, const BundleMethodOptions& options);

// The global adjustment alone.
BundleSummary adjust_bal(BalProblem* problem, const BundleOptions& options);

}  // namespace raysfm
