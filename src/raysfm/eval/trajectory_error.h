#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/eval/alignment.h"
#include "raysfm/eval/association.h"
#include "raysfm/eval/kitti_drift.h"
#include "raysfm/geometry/trajectory.h"

namespace raysfm {

// Of distances, in units of the truth.
struct ErrorStatistics {
  double rmse = 0;
  double mean = 0;
  double median = 0;
  double max = 0;
};

// Of a list that is not empty; the median of an even number of values is the mean of the middle two.
ErrorStatistics error_statistics(std::vector<double> errors);

// Relative pose error E = (truth_i^-1 truth_j)^-1 (estimate_i^-1 estimate_j) over pairs (i, j), root mean
// square, as evo defines it (Sturm et al. 2012).
struct RelativeError {
  double trans = 0;  // units of the truth
  double rot_deg = 0;
};

// Indices of two poses of a trajectory, whose motion is compared.
struct PosePair {
  int first = 0;
  int last = 0;
};

// Poses of equal index belong together; `pairs` is not empty.
RelativeError relative_error(std::span<const Rigid3> estimate, std::span<const Rigid3> truth,
                             std::span<const PosePair> pairs);

// How trajectories are associated and aligned.
struct EvaluationOptions {
  Alignment alignment = Alignment::kSim3;
  double max_dt = 0.01;  // seconds, >= 0
};

// Lengths are in units of the truth, metres as a rule.
struct Evaluation {
  Similarity3 truth_from_estimate;
  std::vector<Match> matches;
  std::vector<double> position_errors;  // one per match: distance after alignment
  // Rows are the axes of the horizontal plane, see below: the longest extent of the true path to the right,
  // and the other one such that a drawing with it upwards is a view from above the cameras (whose y axes
  // point down).
  Eigen::Matrix<double, 2, 3> plane_from_world;

  double coverage = 0;             // matched poses / poses of the truth, in [0, 1]
  double length = 0;               // of the true path, from the first matched pose to the last
  ErrorStatistics ate;             // of position_errors
  ErrorStatistics ate_horizontal;  // the same within the horizontal plane, see below
  RelativeError rpe;               // over consecutive matched poses
  std::optional<KittiDrift> kitti;

  // LBA09 5.2: mean error relative to the length of the path.
  double percent_of_path() const { return length > 0 ? 100.0 * ate.mean / length : 0.0; }
};

// Compares a trajectory with the truth. The horizontal plane of LBA09 5.2, where GPS has an altitude axis, is
// here the plane of motion: that of the two largest principal components of the true positions. It does not
// depend on which axis of the world points up, and is the ground for anything that drives or walks. On a
// straight path its second direction is whatever little the path deviates from straight.
//
// Fails (bad input) when fewer poses match than the alignment needs: three, or two without alignment.
Result<Evaluation> evaluate(const Trajectory& estimate, const Trajectory& truth,
                            const EvaluationOptions& options);

}  // namespace raysfm
