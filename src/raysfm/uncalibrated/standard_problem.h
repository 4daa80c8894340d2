#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/uncalibrated/lens_adjustment.h"
#include "raysfm/uncalibrated/observation_index.h"
#include "raysfm/uncalibrated/point_elimination.h"

namespace raysfm {

// The standard adjustment with the free numbers of the lenses as unknowns (IFBA01 4, the rival), as
// levenberg_marquardt() takes it. Each image has a block of its pose and, unless all lenses are equal, its
// lens; equal lenses are shared numbers.
class StandardProblem {
 public:
  // As IntrinsicsFreeProblem; the lenses of `scene` are the start and meet the constraints.
  StandardProblem(const ObservationIndex& index, const LensAdjustmentOptions& options,
                  UncalibratedScene scene);

  double linearize();
  LmStep solve(double damping);
  LmTrial evaluate(bool linearize);
  void accept();

  const UncalibratedScene& scene() const { return scene_; }
  const std::vector<double>& costs() const { return costs_; }

  // As IntrinsicsFreeProblem's.
  std::vector<Eigen::Matrix<double, 5, 5>> lens_covariances();

 private:
  bool shared() const { return options_.constraints.equal; }
  int prior_count() const { return shared() ? 1 : index_.image_count(); }
  int lens_rows(int image) const { return shared() ? 6 * index_.image_count() : block_ * image + 6; }
  double cost(const UncalibratedScene& scene);
  void normal_equations(const UncalibratedScene& scene);
  void linearize_image(int j, const UncalibratedScene& scene);
  void add_priors(const UncalibratedScene& scene);
  bool factorize(double damping);

  const ObservationIndex& index_;
  const LensAdjustmentOptions options_;
  UncalibratedScene scene_, trial_;
  double cost_ = 0, trial_cost_ = 0;
  std::vector<double> weight_, costs_;
  Eigen::MatrixXd basis_;  // 5 x p
  int free_ = 0;           // p
  int block_ = 6;
  PointElimination elimination_;
  Eigen::VectorXd steps_;  // of the camera numbers
};

}  // namespace raysfm
