#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/lenses/lens_constraints.h"
#include "raysfm/lenses/observation_index.h"
#include "raysfm/lenses/radial_distortion.h"
#include "raysfm/lenses/uncalibrated_scene.h"
#include "raysfm/optim/levenberg_marquardt.h"

namespace raysfm {

// Poses and lenses from points whose positions are known and stay (Zhang 2000, section 3.3), as
// levenberg_marquardt() takes it. Lenses that are equal have one radial distortion as well, and are
// eliminated last; others have none, and every image is a problem of its own.
class KnownStructureProblem {
 public:
  // The scene's images and points are those of `index`; its lenses meet the constraints.
  KnownStructureProblem(const ObservationIndex& index, const LensConstraints& constraints,
                        UncalibratedScene scene, const RadialDistortion& distortion);

  double linearize();
  LmStep solve(double damping);
  LmTrial evaluate(bool linearize);
  void accept();

  const UncalibratedScene& scene() const { return state_.scene; }
  const RadialDistortion& distortion() const { return state_.distortion; }

  // Covariance of the free numbers of a lens (columns of lens_basis()), then of the distortion where there is
  // one, for observations of standard deviation 1 px, from the normal equations of the last linearize().
  // Empty when they leave something undetermined.
  Eigen::MatrixXd lens_covariance(int image);

 private:
  static constexpr int kMaxLens = 7;  // five numbers and the distortion
  struct State {
    UncalibratedScene scene;
    RadialDistortion distortion;
  };
  struct Block {  // of an image
    Eigen::MatrixXd u, cross, inverse;
    Eigen::VectorXd gradient;
  };

  int lens_count() const { return constraints_.equal ? 1 : index_.image_count(); }
  double cost(const State& state) const;
  void normal_equations(const State& state);
  void linearize_image(int j, const State& state);
  void add_prior(const State& state);
  bool eliminate(double damping);

  const ObservationIndex& index_;
  const LensConstraints constraints_;
  const Eigen::MatrixXd basis_;
  const int free_;  // numbers of a lens, the distortion included
  State state_, trial_;
  double cost_ = 0, trial_cost_ = 0;
  std::vector<Block> blocks_;
  Eigen::MatrixXd shared_, reduced_;
  Eigen::VectorXd shared_gradient_, right_, shared_step_;
  std::vector<Eigen::VectorXd> steps_;
};

}  // namespace raysfm
