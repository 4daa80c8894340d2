#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "raysfm/bundle/bundle_problem.h"
#include "raysfm/calibration/rig_parameters.h"

namespace raysfm {

// What observations say of a calibration once poses and points have adapted to it: a quadratic of the cost
// about the calibration `at`.
struct CalibrationEvidence {
  Eigen::VectorXd at;           // values of RigParameters
  Eigen::MatrixXd information;  // second derivative of the cost
  Eigen::VectorXd gradient;
  // Covariance of the gradient, where errors go together in the points of a neighbourhood and in an image:
  // the sum of the outer products of what each such cluster adds to it.
  Eigen::MatrixXd scatter;
  Eigen::MatrixXd lens_scatter;  // the same where no shutter rolls: what a readout would explain is error
  double cost = 0;               // at `at`, poses and points adapted
  int observations = 0;

  static CalibrationEvidence nothing(const Eigen::VectorXd& at);

  // Adds what other observations say of the same unknowns, perhaps about other values.
  void add(const CalibrationEvidence& other);
};

// From one linearisation of a problem of cameras or rays near its minimum, whose cameras are those of
// parameters.rig(values) and whose rays, if any, were observed with `weight`. One pose at least must not be
// free and no point fixed; problem.scale_prior is not looked at. `velocities`: how fast each observed point
// moves in its image, pixels per second; empty: not at all. Nothing where there is nothing to adjust.
std::optional<CalibrationEvidence> measure_calibration(const BundleProblem& problem,
                                                       const BundleOptions& options,
                                                       const RigParameters& parameters,
                                                       const Eigen::VectorXd& values,
                                                       AngularWeight weight = AngularWeight::kPixel,
                                                       std::span<const Eigen::Vector2d> velocities = {});

}  // namespace raysfm
