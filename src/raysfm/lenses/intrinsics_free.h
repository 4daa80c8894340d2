#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <span>
#include <vector>

#include "raysfm/lenses/lens_adjustment.h"
#include "raysfm/lenses/observation_index.h"
#include "raysfm/lenses/point_elimination.h"
#include "raysfm/lenses/triangular_factor.h"
#include "raysfm/optim/levenberg_marquardt.h"

namespace raysfm {

// The intrinsics-free adjustment (IFBA01 section 4) as levenberg_marquardt() takes it.
//
// Image j predicts p = T_p q, q = T_m^-1 m: T_p and T_m are the triangular factors of the moments of its
// pixels and of its projections m, over the points seen in it. When they move by e = T_m^-1 dm, q moves by
// e - Phi q, and the five numbers of Phi are averages of products of q and e. All the averages that occur in
// the normal equations, whatever the metric G of the residual, are six:
//
//     f = F dx = sum w (q1 e1, q2 e1, e1, q1 e2, q2 e2, e2) / sum w
//
// so J^T J = A + F^T Lambda F, where A is that of an adjustment with the lenses held fixed, sparse, and
// Lambda has one 6x6 block for each image (rank five at most comes from the moments of the residual in the
// invariant space: -1 five times and +1 once, times sum w). Constraints on the lenses are rows on f too, and
// only add to Lambda. The solution needs A's Schur complement and 6 more rows for each image:
//
//     A dx + F^T z = -g,   z = gamma + Lambda f,   Gamma = F A^-1 F^T,
//     (I + Lambda Gamma) z = gamma + Lambda h,   h = -F A^-1 g,   f = h - Gamma z
//
// The points eliminated from A (S, s) and its rows parted into those of the poses (x) and those of f:
//
//     L L^T = S_xx,   Y = L^-1 S_xf,   y = L^-1 s_x
//     Gamma = Y^T Y - S_ff,   h = s_f - Y^T y,   dx of the poses = -L^-T (y + Y z)
//
// With Lagrange multipliers eta, the rows E f = -c are met by the step: z gets a term E^T eta.
// Damping is Marquardt's on the diagonal of A.
class IntrinsicsFreeProblem {
 public:
  // Tracks by `index`; `scene` holds poses and points of the indexed images and points only, all in front.
  IntrinsicsFreeProblem(const ObservationIndex& index, const LensAdjustmentOptions& options,
                        UncalibratedScene scene);

  // False when the pixels of some image lie on a line.
  bool valid() const { return valid_; }

  double linearize();
  LmStep solve(double damping);
  LmTrial evaluate(bool linearize);
  void accept();

  const UncalibratedScene& scene() const { return scene_; }  // lenses are those of the last cost
  const std::vector<double>& costs() const { return costs_; }
  const std::vector<ConstraintRow>& rows() const { return rows_; }

  // Residual of every observation (2 numbers, times the root of the weight), then of every constraint row,
  // at `scene`; sets the lenses of `scene`. Empty where some point is not in front of its camera.
  std::vector<double> residuals(UncalibratedScene* scene);

  // The last step, for tests: 6 numbers for each pose (retract()), then 3 for each point.
  Eigen::VectorXd step() const;
  // Diagonal by which the damping is scaled, in the same order.
  Eigen::VectorXd damping_scale() const;

  // Covariance of the numbers of each lens for observations of standard deviation 1 px, from the normal
  // equations of the last linearize(): the noise moves the moments of the pixels and, through the
  // adjustment, those of the projections. Empty when the constraints leave lenses undetermined.
  std::vector<Eigen::Matrix<double, 5, 5>> lens_covariances();

 private:
  struct Image {
    TriangularFactor t_p, t_p_inverse, t_m, t_m_inverse;
    double weight = 0;                           // sum of the weights
    Eigen::Matrix<double, 6, 6> own_lambda;      // without constraints
    Eigen::Matrix<double, 5, 5> lens_by_factor;  // dk = lens_by_factor * phi
  };

  bool measure_moments();
  bool project_image(int j, const UncalibratedScene& scene);
  double image_cost(int j) const;
  void linearize_image(int j, const UncalibratedScene& scene);
  double cost(UncalibratedScene* scene);
  void normal_equations(const UncalibratedScene& scene);
  void add_constraints(const UncalibratedScene& scene);
  Eigen::Matrix2d metric_root(int j) const;
  Eigen::Vector2d residual(int j, int o) const;
  void part_reduced_system();
  bool find_low_rank(double damping);
  bool solve_low_rank();
  Eigen::MatrixXd rows_times(const Eigen::MatrixXd& x, bool exact_rows) const;
  Eigen::MatrixXd lambda_times(const Eigen::MatrixXd& x, bool exact_rows) const;
  std::vector<int> imposed_rows() const;

  const ObservationIndex& index_;
  const LensAdjustmentOptions options_;
  UncalibratedScene scene_, trial_;
  double cost_ = 0, trial_cost_ = 0;
  bool valid_ = false;
  std::vector<double> weight_, costs_;
  std::vector<ConstraintRow> rows_;
  std::vector<double> violations_;        // of rows_, where the normal equations are
  std::vector<double> trial_violations_;  // where the cost was taken last
  Eigen::MatrixXd row_coefficients_;      // 12 x rows: on f of the image, then of the reference
  std::vector<Image> images_;
  std::vector<Eigen::Vector3d> in_camera_;  // of an observation
  std::vector<Eigen::Vector2d> invariant_;  // q of an observation
  WorkTeam team_;
  PointElimination elimination_;
  Eigen::VectorXd pose_scale_;  // diagonal of A, poses
  Eigen::VectorXd gamma_;       // 6 for each image
  // Of a step: L, Y, y, Gamma, h, z, f and eta of the class comment, the system for z and eta, and the steps
  // of the poses.
  Eigen::MatrixXd l_, y_xf_, capital_gamma_, system_;
  Eigen::VectorXd y_x_, h_, z_, f_, eta_, pose_steps_;
  Eigen::PartialPivLU<Eigen::MatrixXd> lu_;
};

}  // namespace raysfm
