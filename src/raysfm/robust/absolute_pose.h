#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/optim/robust_loss.h"
#include "raysfm/robust/pose_refinement.h"

namespace raysfm {

// Squared radius of the 90 % confidence ellipsoid of a position: x^T C^-1 x <= 6.25 (LBA09 2.3).
inline constexpr double kEllipsoid90 = 6.25;

enum class PoseMethod {
  kThreeRays,  // minimal samples of three rays (generalised_p3p.h)
  kFiveRays,   // LBA09 4.5: five rays, adjusted from the prior
};

// How a pose is sought.
struct PoseOptions {
  PoseMethod method = PoseMethod::kThreeRays;
  double max_error_px = 3.0;  // > 0: residual of an inlier; with sigmas, standard deviations
  int min_inliers = 12;       // >= 4: fewer is a failure
  int max_iterations = 1000;  // samples
  double confidence = 0.999;  // in (0, 1)
  // A prior pose that explains at least this part of the observations is taken without drawing samples.
  double prior_inlier_ratio = 0.7;
  int max_refinements = 20;                        // Levenberg-Marquardt iterations
  RobustLoss loss{RobustLoss::Kind::kHuber, 1.0};  // scale in pixels
  uint64_t seed = 0;
  uint64_t stream = 0;
};

// Why there is no pose.
enum class PoseProblem {
  kNone,
  kTooFewObservations,  // fewer than min_inliers were given, or none has a ray
  kTooFewInliers,       // no pose explains min_inliers of them
  kDegenerate,          // the points do not determine the pose: J^T J is singular
};

// A pose with what agrees with it, or why there is none.
struct PoseEstimate {
  PoseProblem problem = PoseProblem::kTooFewObservations;
  Rigid3 rig_from_world;
  std::vector<uint8_t> inlier;  // one per observation, 0 or 1
  int inlier_count = 0;
  // Of the tangent of rig_from_world, see retract(); points held fixed: sigma_px^2 (J^T J)^-1.
  Matrix6d covariance = Matrix6d::Zero();
  // Standard deviation of one coordinate of the inliers' residuals; with a robust loss the one that makes the
  // formula above hold for the M-estimate (Huber 1981, 7.6). With sigmas, the factor that they all lack.
  double sigma_px = 0;
  int iterations = 0;  // samples drawn; 0: the prior was taken

  bool ok() const { return problem == PoseProblem::kNone; }
};

// The covariance as covariance.csv holds it (docs/conventions.md): of the position and orientation of the rig
// in the world's axes. The first 3x3 block is the covariance C of the position; the 90 % ellipsoid is
// x^T C^-1 x <= kEllipsoid90.
Matrix6d covariance_in_world(const Rigid3& rig_from_world, const Matrix6d& covariance);

// Estimates poses; keeps the buffers that grow with the observations from call to call. One per thread.
class PoseEstimator {
 public:
  PoseEstimator();
  ~PoseEstimator();
  PoseEstimator(PoseEstimator&&) noexcept;
  PoseEstimator& operator=(PoseEstimator&&) noexcept;

  // Robust pose (LBA09 2.3 and 4.5): RANSAC over samples of three rays of any cameras of the rig on the
  // angular error weighted to pixels, then refine(). `prior` may be null; it is the first hypothesis and
  // never trusted beyond its score. Observations whose pixel has no ray are never inliers. With
  // observations.rays the rig is not looked at.
  void estimate(const Rig& rig, const PoseObservations& observations, const Rigid3* prior,
                const PoseOptions& options, PoseEstimate* result);

  // Levenberg-Marquardt over the six parameters on the residuals (of pixels, or of rays where given) of the
  // observations marked in result->inlier, from result->rig_from_world; updates the inliers on the way, then
  // covariance and sigma.
  void refine(const Rig& rig, const PoseObservations& observations, const PoseOptions& options,
              PoseEstimate* result);

 private:
  void refine_loaded(const Rig& rig, const PoseObservations& observations, const PoseOptions& options,
                     PoseEstimate* result);

  struct Workspace;
  std::unique_ptr<Workspace> workspace_;
};

}  // namespace raysfm
