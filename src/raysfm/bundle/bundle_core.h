#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "raysfm/bundle/bundle_problem.h"
#include "raysfm/bundle/observation_layout.h"
#include "raysfm/core/paged_memory.h"
#include "raysfm/optim/schur_system.h"
#include "raysfm/residuals/block_residual.h"
#include "raysfm/residuals/normal_kernel.h"

namespace raysfm {

// The state of one adjustment, for levenberg_marquardt() and for the covariance. N is 6, or 9 where the poses
// have lenses. Memory only grows.
template <int N>
class BundleCore {
 public:
  // False where nothing moves. The problem must be valid and stay where it is until store(). Inliers are
  // used; all must be taken where mark_inliers() is to follow.
  bool load(const BundleProblem& problem, const BundleOptions& options, Taking taking = Taking::kInliers);
  void store() const;
  int used() const { return active_count_; }
  int dropped() const { return dropped_; }

  double linearize();
  LmStep solve(double damping);
  LmTrial evaluate(bool linearize);
  void accept();

  // Makes inliers, of the problem too, of the observations whose residual at the current state is at most the
  // threshold: these are used from now on.
  void mark_inliers(double threshold);

  const ObservationLayout& layout() const { return layout_; }
  SchurSystem<N>& system() { return system_; }
  WorkTeam& team() { return *team_; }

 private:
  // Poses, points and what each lane costs there.
  struct State {
    LargeArray<Rigid3> poses;
    LargeArray<BalLens> lenses;
    LargeArray<Eigen::Vector3d> points;
    LargeArray<double> lane_cost;
    void load(const BundleProblem& problem, size_t lane_count);
  };
  using Block = ObservationBlock<N>;

  // A pose, to transform points by eights. Where it is not finite, all points are lost.
  struct Frame {
    explicit Frame(const Rigid3& pose);
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rotation;
    Eigen::Vector3d translation;
  };

  void load_rays();
  template <typename Use>
  auto with_residual(const ObservationLayout::Group& group, const State& state, Use use) const;
  void load_points(int begin, const State& state, Block* block) const;
  void mark_group(const ObservationLayout::Group& group, const BlockResidual& residual, double threshold);
  void move(State& state) const;
  double work(State& state, bool linearize);
  double scale_prior_cost(const State& state, bool linearize);
  double work_on_chunk(int chunk, State& state, bool linearize);
  double work_on_group(const ObservationLayout::Group& group, State& state, bool linearize, bool* loses);
  double work_on_lanes(const ObservationLayout::Group& group, const BlockResidual& residual, State& state,
                       bool linearize, bool* loses);
  bool score_block(int begin, Block& block, LargeArray<double>& lane_cost, double* lane_sums);
  void store_block(int begin, const Block& block);
  void store_point_terms(int lane, const Block& block, int k);
  void clear_points();
  void sum_points(int begin, int end);
  bool has_residual(const State& state, int lane) const;
  void collect_lost();
  void shorten_steps_of_lost();
  void drop_lost();
  void find_unsettled(LmStep* step);
  void settle_points();
  double cost_without_lost(const State& state);

  BundleProblem problem_;
  RobustLoss loss_;
  double settled_ = 0;
  bool settles_ = false;  // points come to rest after the present step
  std::unique_ptr<WorkTeam> team_;
  ObservationLayout layout_;
  SchurSystem<N> system_;
  State current_, trial_;
  LargeArray<RayBlock> rays_;         // by block of lanes
  ScratchArray<double> point_terms_;  // V and gp of each lane, where several threads work on the poses
  LargeArray<double> chunk_cost_;
  LargeArray<uint8_t> active_;   // by lane: an inlier that has a residual
  LargeArray<uint8_t> is_lost_;  // by lane: active, but without a residual in the last pass
  LargeArray<int> lost_;
  LargeArray<uint8_t> chunk_loses_;
  LargeArray<uint8_t> is_unsettled_;  // by point of the problem: it moves by itself
  LargeArray<uint8_t> all_held_;      // by pose of the problem
  std::unique_ptr<BundleCore> of_points_;
  int active_count_ = 0, dropped_ = 0;
  double current_cost_ = 0, trial_cost_ = 0;
  bool is_used_up_ = false;  // the normal equations, by a solution
  int prior_pose_ = -1;      // in the system
};

extern template class BundleCore<6>;
extern template class BundleCore<9>;

}  // namespace raysfm
