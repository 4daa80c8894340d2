#pragma once

#include <vector>

#include "raysfm/bundle/bundle_problem.h"
#include "raysfm/core/paged_memory.h"

namespace raysfm {

// Which observations of a problem take part.
enum class Taking { kInliers, kAll };

// The observations of a problem in the order in which the adjustment works on them: by pose, then by camera,
// padded so that each group of one pose and one camera fills whole blocks of kBlockLanes lanes. Where no
// camera is looked at (rays, lenses), a pose is one group.
//
//     lanes   | pose 0, camera 0 . . . | pose 0, camera 1 . | pose 1, camera 0 . . |        . padding
//     groups    0                        1                    2
//     chunks    0                                             1
//
// And the numbering of what moves: free poses and points that are not fixed, both with an observation,
// and the slots of the normal equations (optim/schur_system.h). Memory only grows.
struct ObservationLayout {
  struct Group {
    int pose, camera;
    int system_pose;  // -1: does not move
    int begin, end;   // lanes
    bool opens_pose;  // the first group of its pose
  };
  struct Lane {
    int observation;   // -1: padding
    int point;         // a valid index even in the padding
    int system_point;  // -1: does not move
    int slot;          // -1: pose or point does not move
    bool opens_slot;   // the first lane of its slot
  };

  LargeArray<Group> groups;
  LargeArray<Lane> lanes;
  LargeArray<double> u, v;        // observed pixel, by lane
  LargeArray<double> weight;      // 1 / sigma^2 by lane; empty where the problem has no sigmas
  LargeArray<int> chunks;         // first group of each unit of work, then the number of groups; whole poses
  LargeArray<int> poses, points;  // index in the problem, by number in the system
  LargeArray<int> lane_begin, lanes_of_point;  // by system point, ascending
  LargeArray<int> point_begin;                 // slots by system point
  LargeArray<int> pose_of_slot;

  // The problem must be valid.
  void build(const BundleProblem& problem, Taking taking = Taking::kInliers);

 private:
  void sort_observations(const BundleProblem& problem, Taking taking);
  void fill_lanes(const BundleProblem& problem);
  void reserve_lanes(size_t most_groups);
  void weigh_lanes(const BundleProblem& problem);
  void list_lanes_of_points();
  void assign_slots();
  void cut_chunks();

  LargeArray<int> order_, sorted_, counts_, system_point_, place_, group_of_block_;
};

// Whether sizes and indices agree and the options are in range.
bool is_valid(const BundleProblem& problem, const BundleOptions& options);

}  // namespace raysfm
