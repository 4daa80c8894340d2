#include "raysfm/uncertainty/scale_uncertainty.h"

#include "raysfm/uncertainty/calibration_changes.h"

namespace raysfm {

double scale_sigma_by_calibration(const BundleProblem& problem, std::span<const Eigen::Vector2d> by_residual,
                                  const TrackingRig& rig, std::span<const Rig> deviations) {
  const CalibrationChanges calibration(rig, deviations);
  Eigen::Matrix2Xd changes(2, calibration.size());
  Eigen::RowVectorXd sums = Eigen::RowVectorXd::Zero(calibration.size());
  for (size_t i = 0; i < by_residual.size(); ++i) {
    if (by_residual[i].isZero(0)) continue;
    const BundleObservation& o = problem.observations[i];
    const Eigen::Vector3d in_rig = problem.rig_from_world[o.pose] * problem.points[o.point];
    const ObservedRay* ray = problem.rays.empty() ? nullptr : &problem.rays[i];
    if (!calibration.at(o.camera, o.pixel, ray, in_rig, changes)) continue;
    const double sigma = problem.sigmas.empty() ? 1 : problem.sigmas[i];
    sums.noalias() += by_residual[i].transpose() / sigma * changes;
  }
  return sums.norm();
}

}  // namespace raysfm
