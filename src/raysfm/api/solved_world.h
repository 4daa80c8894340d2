#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "raysfm/geometry/pose.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/solving/solve_input.h"

namespace raysfm {

// What was found of some of the images of an input, in any frame; the spans must outlive it.
struct SolvedWorld {
  std::span<const Rigid3> cam_from_world;   // one per image
  std::span<const Matrix6d> covariances;    // of the tangents (v, w) of these, see retract()
  std::span<const Eigen::Vector3d> points;  // one per point
  std::span<const uint8_t> image_posed, point_placed;
  std::span<const uint8_t> inlier;  // one per observation
  double rms_px = 0;                // over the inliers
  bool is_given = false;            // its frame and scale are those of known points, and stay
  StartSummary start;
};

// The frames of an input, none of which has a pose.
std::vector<PosedFrame> frames_of(const SolveInput& input);

// Adds poses, key frames, points and observations as another segment of a reconstruction, which has
// frames_of(). Poses are told from the camera of the first image with a pose, unless the world is given.
void add_world(const SolveInput& input, const SolvedWorld& world, Reconstruction* reconstruction);

// The same of images of a known camera; covariances from what their inliers say, the points held.
void add_world(const SolveInput& input, const RayReconstruction& found, Reconstruction* reconstruction);

// Why each segment ended, when frames without a pose have their reasons.
void give_reasons(const SolveInput& input, bool interrupted, Reconstruction* reconstruction);

}  // namespace raysfm
