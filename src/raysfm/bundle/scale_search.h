#pragma once

#include "raysfm/bundle/bundle_adjuster.h"

namespace raysfm {

struct ScaleSearch {
  double distance = 0;  // between the two poses of the prior, at the scale of least cost
  double sigma = 0;     // of the logarithm of the scale; infinite where nothing tells it
};

// Poses and points at a multiple of their scale about a centre, in world axes.
void scale_world(double factor, const Eigen::Vector3d& center, std::span<Rigid3> rig_from_world,
                 std::span<Eigen::Vector3d> points);

// The scale of a world that is seen along rays of different origins, where it is so weak an unknown among the
// others that an adjustment would not find it: estimate_scale() and an adjustment with the scale held in
// turn, and poses and points are left at the scale of least cost. problem.scale_prior names two poses, its
// `from` not free and its distance where the search begins; nothing else may be fixed. The search goes no
// farther than a factor of about a hundred either way, and ends where the scale proves to be unknown by a
// factor of more than about three.
ScaleSearch search_scale(BundleAdjuster& adjuster, const BundleProblem& problem,
                         const BundleOptions& options);

}  // namespace raysfm
