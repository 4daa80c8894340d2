#pragma once

#include <Eigen/Core>
#include <cmath>
#include <span>
#include <vector>

#include "raysfm/lenses/lens_adjustment.h"
#include "raysfm/lenses/observation_index.h"
#include "raysfm/lenses/point_elimination.h"
#include "raysfm/optim/levenberg_marquardt.h"

namespace raysfm {

// What the numbers of the lenses are in a StandardProblem.
enum class LensRole {
  kUnknown,    // unknowns beside the poses and the points
  kDependent,  // functions of them: those that fit best, by linear least squares
};

// The adjustment of poses, points and the free numbers of the lenses, as levenberg_marquardt() takes it. Each
// image has a block of its pose and, unless all lenses are equal, its lens; equal lenses are shared numbers.
//
// The coefficients of a radial distortion that all images share may be unknowns beside unknown, equal lenses.
//
// With unknown lenses it is the standard adjustment (IFBA01 section 4, the rival). With dependent ones the
// cost is a function of poses and points alone, which has the same minimum: pixels are linear in the numbers
// of a lens, so that the best ones are had at once (variable projection; Golub, Pereyra, Inverse Problems
// 19(2), 2003). The step is that of the joint system with the lenses not damped, Kaufman's approximation. Far
// from the minimum the lens that fits wrong poses best is a bad one, and the lenses are unknowns until a
// step, or fitting them, gains less than half of the cost.
// Unknown lenses that some images share are told to be one by a weight (as IFBA01 4.3 imposes constraints).
// Once memory is set up, nothing is allocated.
class StandardProblem {
 public:
  // As IntrinsicsFreeProblem; the lenses of `scene` meet the constraints and, unless dependent, are the
  // start.
  StandardProblem(const ObservationIndex& index, const LensAdjustmentOptions& options,
                  UncalibratedScene scene, LensRole role);

  // False when some point is not in front of its camera, or a focal length not above 0.
  bool valid() const { return std::isfinite(cost_); }

  double linearize();
  LmStep solve(double damping);
  LmTrial evaluate(bool linearize);
  void accept();

  const UncalibratedScene& scene() const { return scene_; }
  const RadialDistortion& radial() const { return radial_; }
  const std::vector<double>& costs() const { return costs_; }

  // As IntrinsicsFreeProblem's.
  std::vector<Eigen::Matrix<double, 5, 5>> lens_covariances();

  // How much the observations of each point move the numbers of the lens that all images share, to first
  // order about the present state: fx, fy, cx, cy, skew, k1, k2 in a column for each point. Call after
  // linearize(); empty where the lenses are not equal.
  Eigen::Matrix<double, 7, Eigen::Dynamic> influences();

  // The last step, for tests: the numbers of the images and the shared ones, then 3 for each point.
  Eigen::VectorXd step() const;

 private:
  using Matrix5d = Eigen::Matrix<double, 5, 5>;
  using Matrix26d = Eigen::Matrix<double, 2, 6>;
  using Matrix27d = Eigen::Matrix<double, 2, 7>;
  bool shared() const { return options_.constraints.equal; }
  int lens_count() const { return shared() ? 1 : index_.image_count(); }
  int lens_rows(int image) const { return shared() ? 6 * index_.image_count() : block_ * image + 6; }
  RadialDistortion moved(const RadialDistortion& radial, const Eigen::VectorXd& steps) const;
  Eigen::Vector2d predicted(const Lens& lens, int observation, const RadialDistortion& radial) const;
  void jacobians(const Lens& lens, int observation, Matrix26d* by_pose, Matrix27d* by_lens) const;
  bool project(const UncalibratedScene& scene);
  bool project_image(int j, const UncalibratedScene& scene);
  double image_cost(int j, const Lens& lens, const RadialDistortion& radial) const;
  void fit_lenses(UncalibratedScene* scene) const;
  double cost(UncalibratedScene* scene, const RadialDistortion& radial);
  double start_cost();
  void normal_equations(const UncalibratedScene& scene);
  void linearize_image(int j, const UncalibratedScene& scene);
  void sum_point(int point);
  void add_priors(const UncalibratedScene& scene);
  void group_images();
  LensVector mean_lens(const std::vector<int>& group, const UncalibratedScene& scene) const;
  double sharing_cost(const UncalibratedScene& scene) const;
  void add_sharing(const UncalibratedScene& scene);
  bool factorize(double damping);

  const ObservationIndex& index_;
  const LensAdjustmentOptions options_;
  const LensRole role_;
  const LensExpectation expected_;
  UncalibratedScene scene_, trial_;
  RadialDistortion radial_, trial_radial_;
  bool fitting_ = false;  // dependent, and near enough
  double cost_ = 0, trial_cost_ = 0;
  std::vector<double> costs_;
  Matrix5d basis_ = Matrix5d::Zero();  // the first p columns
  int free_ = 0;                       // p
  int numbers_ = 0;                    // of a lens that are unknown: p, and the coefficients of distortion
  int block_ = 6;
  std::vector<Eigen::Vector3d>
      in_view_;  // of an observation: x / z, y / z, 1 / z, where the cost was taken last
  std::vector<std::vector<int>> groups_;  // images of one lens, where some share one
  double sharing_weight_ = 0;             // of a lens about the mean of its group, per square pixel
  std::vector<double> image_costs_;
  // Of an image, what it adds to the normal equations of the numbers of lenses: matrix, then gradient.
  std::vector<Eigen::Matrix<double, 7, 8>> lens_terms_;
  WorkTeam team_;
  PointElimination elimination_;
  Eigen::VectorXd damping_scale_;  // diagonal of U, 0 for dependent lenses
  Eigen::VectorXd steps_;          // of the camera numbers
};

}  // namespace raysfm
