#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "raysfm/camera/observed_ray.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/robust/three_view_start.h"
#include "raysfm/solvers/ray_class.h"

namespace raysfm {

// Rays of the same points in three views of a rig, views 0 and 2 the farthest apart: a flat list, in any
// order. A point needs a ray in each view, and may have several, of other cameras that see it at the same
// instant. The arrays have one length.
struct RigMatches {
  int point_count = 0;
  std::span<const ObservedRay> rays;  // in the rig's frame at the time of the view
  std::span<const int> points;        // point of each ray, in [0, point_count)
  std::span<const int> views;         // 0, 1 or 2
  std::span<const int> cameras = {};  // camera of each ray, >= 0; empty: all of camera 0
};

enum class GenericStartMethod {
  kAuto,            // by the rays: kCentral, kStereoPoints or kFivePoints
  kCentral,         // start_from_three_views(), where all rays pass one centre
  kStereoPoints,    // points from several rays at the instant of view 0, then the pose of views 1 and 2
  kFivePoints,      // five points in one camera, the scale from all that others see
  kSeventeenPoint,  // LBA09 4.3
};

// What three views must show to be a start.
struct GenericStartOptions {
  GenericStartMethod method = GenericStartMethod::kAuto;
  // Largest residual of an inlier in each of its rays, in the unit of the rays' residuals: pixels where
  // they are whitened, else tangents of angles; standard deviations where each ray's tangents are divided by
  // its own (kCentral then takes their median for all).
  double max_error = 1.5;
  int min_matches = 30;              // >= 6
  int min_inliers = 25;              // >= 6
  double min_inlier_ratio = 0.4;     // in (0, 1]
  double min_displacement = 5e-3;    // radians: median angle between the directions of views 0 and 2
  double min_parallax = 3e-3;        // radians: as in ThreeViewOptions
  double rotation_advantage = 0.85;  // as in ThreeViewOptions
  double min_rival_cost = 1.05;      // as in ThreeViewOptions, for kCentral alone
  // Significance below which the scale counts as unknown.
  double min_scale_significance = 6;
  int max_iterations = 1000;
  double confidence = 0.9999;
  uint64_t seed = 0;
  uint64_t stream = 0;
};

// Three poses of a rig and the points they see, or why there are none.
struct GenericStart {
  StartProblem problem = StartProblem::kTooFewMatches;
  Rigid3 rig1_from_rig0, rig2_from_rig0;
  std::vector<Eigen::Vector3d> points_in_rig0;  // one per point; meaningful where inlier
  std::vector<uint8_t> inlier;                  // one per point, 0 or 1
  int inlier_count = 0;
  GenericStartMethod method = GenericStartMethod::kAuto;  // the one used

  // Whether the distances between the rays' origins tell the scale. Where not, the centre of the camera with
  // most points moves by 1 from view 0 to view 2 if that fits as well as any (as for a central camera, or a
  // translation seen by cameras that share no points), else by the best guess. The significance is the
  // number of standard deviations by which the scale differs from half and from double itself, the lesser
  // of the two: the square root of the rise of the sum of squares, everything else adjusted, over the
  // variance of a residual. The standard deviation of the scale is about its half over the significance.
  bool scale_known = false;
  double scale_significance = 0;

  // The figures behind the diagnosis; filled as far as the search went.
  RayClass ray_class;              // of the rays given
  double median_displacement = 0;  // radians
  double median_parallax = 0;      // radians, of the inliers: the largest angle between two of their rays
  double least_parallax = 0;       // kCentral: see ThreeViewStart; else median_parallax
  double rms_error = 0;            // of the inliers' residuals, in their unit
  int rotation_inliers = 0;        // points that a rotation of far points explains
  double rival_cost = 0;           // kCentral: see ThreeViewStart
  int iterations = 0;

  bool ok() const { return problem == StartProblem::kNone; }
};

// Motion of any rig of ray cameras over three views, and the points seen (LBA09 4.4); the rig's frame at the
// time of view 0 is the world. RANSAC over relative poses of views 0 and 2 (see `method`), pose of view 1 by
// resection, score by the angular residual in all three views, refinement of both poses and all points.
// Points out of range, rays that are not finite and points without a ray in each view are no inliers.
GenericStart start_generic(const RigMatches& matches, const GenericStartOptions& options);

// One line for people, with the figures.
std::string describe(const GenericStart& start);

}  // namespace raysfm
