#pragma once

#include <vector>

#include "raysfm/bundle/bundle_problem.h"
#include "raysfm/core/paged_memory.h"

namespace raysfm {

// The inliers of a problem by pose.
struct ObservationsByPose {
  LargeArray<int> begin;  // one more than there are poses
  LargeArray<int> observations;
  explicit ObservationsByPose(const BundleProblem& problem);
};

// Some successive poses of a problem and what they see, as a problem of its own: copies, which can be moved
// and adjusted apart from the rest. Points that these poses see fewer than twice are left out, unless they
// are fixed.
class ProblemPart {
 public:
  // Poses [first, last) of `whole`, those before first_free held. `skip_unmoved`: without the points that no
  // moving pose sees. Reuses its memory.
  void cut(const BundleProblem& whole, const ObservationsByPose& by_pose, int first, int last, int first_free,
           bool skip_unmoved);

  BundleProblem problem();

  int first() const { return first_; }
  int last() const { return first_ + static_cast<int>(poses.size()); }
  bool is_anchored() const;  // a pose or a point is fixed

  LargeArray<Rigid3> poses;
  LargeArray<BalLens> lenses;
  LargeArray<Eigen::Vector3d> points;
  LargeArray<int> point_ids;  // index in the whole, by point of the part

  // Copies what is free back.
  void store(const BundleProblem& whole) const;

 private:
  void number_points(const BundleProblem& whole, const ObservationsByPose& by_pose, bool skip_unmoved);

  std::span<const Camera> cameras_;
  int first_ = 0;
  LargeArray<uint8_t> pose_is_free_, point_is_fixed_;
  LargeArray<BundleObservation> observations_;
  LargeArray<ObservedRay> rays_;
  LargeArray<float> sigmas_;
  LargeArray<int> sightings_, local_;  // by point of the whole; zero and -1 between two cuts
  LargeArray<uint8_t> moves_;
  bool has_lenses_ = false;
};

// Points that were chosen, or those that were not, with what is seen of them: a problem of its own with the
// poses of the whole.
class PartOfPoints {
 public:
  // `is_chosen`: 1 for each point that is; those of which it is `chosen` are taken. `whole` stays where it
  // is.
  PartOfPoints(const BundleProblem& whole, std::span<const uint8_t> is_chosen, bool chosen);

  bool empty() const { return points_.empty(); }
  BundleProblem problem();

  // Where they are now, and which observations fit, into the whole.
  void store() const;

 private:
  void reserve(size_t observations);

  BundleProblem whole_;
  LargeArray<int> point_ids_, ids_;  // of points and observations in the whole
  LargeArray<Eigen::Vector3d> points_;
  LargeArray<uint8_t> point_is_fixed_, is_inlier_;
  LargeArray<BundleObservation> observations_;
  LargeArray<ObservedRay> rays_;
  LargeArray<float> sigmas_;
};

}  // namespace raysfm
