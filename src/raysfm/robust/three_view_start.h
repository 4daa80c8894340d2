#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Why three views do not start a reconstruction.
enum class StartProblem {
  kNone,
  kTooFewMatches,      // fewer than min_matches were given
  kNoMotion,           // the images hardly differ
  kRotationOnly,       // a rotation without translation explains the matches as well
  kTooFewInliers,      // no rigid motion explains enough of the matches
  kAmbiguous,          // a second motion fits as well: (nearly) coplanar points and straight motion
  kTooLittleParallax,  // a motion was found, but the points are too far for their depths to be known
  kTwoMotions,         // two motions explain about as much of the image each (fair_start.h)
};

struct ThreeViewOptions {
  double max_error = 1e-3;  // radians: an inlier's largest angular error; e.g. 1.5 pixel / pixels_per_radian
  int min_matches = 30;     // >= 5
  int min_inliers = 25;     // >= 5
  double min_inlier_ratio = 0.4;   // in (0, 1]
  double min_displacement = 5e-3;  // radians: median angle between the bearings of views 0 and 2
  double min_parallax = 3e-3;      // radians: least_parallax below which depths are not known
  double rotation_advantage =
      0.85;  // rotation-only inliers / inliers of the full model above which it is a rotation
  // rival_cost below which the start is ambiguous; of fewer than 240 inliers more is asked for
  double min_rival_cost = 1.05;
  int max_iterations = 500;
  double confidence = 0.9999;
  // >= 1: of a start that one search found. A motion far from the right one may agree with most matches where
  // the parallax is small, and a search ends once most agree; the motion that fits best is taken, and others
  // that fit about as well are held against it. There are `searches_in_doubt` of them, and only
  // `searches` where those that end apart have told that more would tell nothing.
  int searches = 4;
  int searches_in_doubt = 8;
  uint64_t seed = 0;
  uint64_t stream = 0;
};

// Poses of three views of one central camera and the points they see, or why there are none.
struct ThreeViewStart {
  StartProblem problem = StartProblem::kTooFewMatches;
  Rigid3 cam1_from_cam0;
  Rigid3 cam2_from_cam0;                        // |translation| = 1
  std::vector<Eigen::Vector3d> points_in_cam0;  // one per match; meaningful where inlier
  std::vector<uint8_t> inlier;                  // one per match, 0 or 1
  int inlier_count = 0;

  // The figures behind the diagnosis, radians; filled as far as the search went.
  double median_displacement = 0;  // between views 0 and 2, rotation included
  double median_parallax = 0;      // of the inliers between views 0 and 2, rotation removed
  double least_parallax = 0;       // the least such median of all motions found that fit about as well
  double rms_error = 0;            // angular error of the inliers in the three views
  int rotation_inliers = 0;        // matches that a pure rotation explains
  double rival_cost = 0;           // of the second motion over that of the first, >= 1; 0: none was found
  int iterations = 0;

  bool ok() const { return problem == StartProblem::kNone; }
};

// Motion of a central camera over three views and the points seen (LBA09 2.2). Unit bearings of the same
// points in the three views, view 0 and view 2 the farthest apart; the frame of view 0 is the world. RANSAC:
// five points between views 0 and 2, triangulation, resection of view 1 from the same five, score in all
// three views. Coplanar points leave two motions to two views; the third view tells them apart
// unless the motion is straight, so that the runner-up is sought and compared. Few or bad matches leave a
// whole valley of motions, which several searches end at different places of. The best motion is refined
// (both poses and all points). The spans have one length.
ThreeViewStart start_from_three_views(std::span<const Eigen::Vector3d> bearings0,
                                      std::span<const Eigen::Vector3d> bearings1,
                                      std::span<const Eigen::Vector3d> bearings2,
                                      const ThreeViewOptions& options);

// One line for people, with the figures, e.g. "rotation without translation explains 98 % of 310 matches".
std::string describe(const ThreeViewStart& start);

}  // namespace raysfm
