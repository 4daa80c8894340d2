#pragma once

#include <Eigen/Core>
#include <array>
#include <utility>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/robust/ransac.h"
#include "raysfm/robust/rig_refinement.h"
#include "raysfm/robust/rig_table.h"

namespace raysfm {

// What the searches for the motion of a rig share: score by the primary rays of the three views, and local
// optimisation. Errors are in the unit of the residuals.
class RigScorer {
 public:
  using Model = RigMotion;

  RigScorer(const RigTable& table, double max_error);

  int size() const { return table_.size(); }
  RansacScore score(const RigMotion& motion, double limit) const;
  void refine(RigMotion* motion);
  void collect_inliers(const RigMotion& motion, std::vector<int>* inliers) const;

 protected:
  const RigTable& table_;

 private:
  struct Frames;
  struct Match {
    Eigen::Vector3d origin0, direction0, origin1, direction1, origin2, direction2;
    double weight1, weight2;
  };
  double error(const Frames& frames, const Match& match) const;

  std::vector<Match> matches_;
  std::vector<int> inliers_;
  RigRefiner refiner_;
};

// Five points of one camera give its motion but for the scale, which is the weighted median of what the
// pairs of rays say that are not of this camera alone.
class FivePointRansac : public RigScorer {
 public:
  static constexpr int kSampleSize = 5;
  static constexpr int kMaxModels = 10;

  FivePointRansac(const RigTable& table, double max_error);

  bool sample(Rng& rng, std::array<int, 5>* sample) const;
  int generate(const std::array<int, 5>& sample, std::array<RigMotion, 10>* motions);
  void refine(RigMotion* motion);

 private:
  struct Group {
    std::vector<int> points;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // mean origin of the primary rays
  };
  // Rays of views 0 and 2 of one point; `group` where both are of its camera, else -1.
  struct Pair {
    int ray0, ray2, group;
  };
  double median_scale(const Rigid3& rig2_from_rig0, const Eigen::Vector3d& unit_direction, int group,
                      int max_pairs);
  int group_with_most(const std::vector<int>& points) const;

  bool rescale(RigMotion* motion);

  std::vector<Group> groups_;  // of cameras with at least five points
  std::vector<int> group_of_;  // of each point, -1: none
  std::vector<Pair> pairs_;
  std::vector<std::vector<int>> pairs_outside_;   // of each group
  std::vector<std::pair<double, double>> votes_;  // inverse scale and weight
  double longest_ = 1e-9;                         // motion that the scale is looked for in
  std::vector<int> scratch_;
};

// LBA09 4.3 and 4.4: seventeen points between views 0 and 2, resection of view 1.
class SeventeenPointRansac : public RigScorer {
 public:
  static constexpr int kSampleSize = 17;
  static constexpr int kMaxModels = 4;

  SeventeenPointRansac(const RigTable& table, double max_error, const RayClass& ray_class)
      : RigScorer(table, max_error), class_(ray_class) {}

  bool sample(Rng& rng, std::array<int, 17>* sample) const;
  int generate(const std::array<int, 17>& sample, std::array<RigMotion, 4>* motions) const;

 private:
  RayClass class_;
};

}  // namespace raysfm
