#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "raysfm/lenses/lens.h"
#include "raysfm/lenses/uncalibrated_scene.h"
#include "raysfm/projective/optimal_triangulation.h"
#include "raysfm/projective/projective_adjustment.h"

namespace raysfm {

// Linear estimate of the absolute dual quadric Q, Q ~ P^-1 of the lenses: P Q P^T ~ K K^T in every view
// (Triggs 1997; Pollefeys, Koch, Van Gool 1999): zero skew, unit aspect ratio, principal point at (0, 0), and
// focal lengths near `focal`, by how much `log_focal_sigma` says: large for lenses that zoom, small for one
// lens of this focal length. Views in units where (0, 0) is the centre of the image.
// The result is the map H with P H metric, or nothing when Q is not positive of rank three.
std::optional<Eigen::Matrix4d> metric_upgrade(std::span<const Matrix34d> views, double focal,
                                              double log_focal_sigma);

// P ~ K [R | t], K with fx, fy > 0. False when the left 3x3 is singular.
bool decompose_view(const Matrix34d& view, Lens* lens, Rigid3* cam_from_world);

// A metric scene of a projective one by H: lenses, poses and points, mirrored where that brings more
// observations in front of their cameras; the scale makes the mean distance of neighbouring things of order
// one. `in_front` gets the share of observations in front. Nothing when a view cannot be decomposed.
std::optional<UncalibratedScene> upgraded_scene(const ProjectiveScene& scene, const Eigen::Matrix4d& upgrade,
                                                const ObservationIndex& index, double* in_front);

// Metric scenes to start from, best first: quadrics over a range of focal lengths, for lenses that zoom and
// for one lens, judged by skew, aspect ratio, principal point and change of the focal length. The units of
// the views are such that focal lengths of 0.3 to 6 are searched. At most `count`.
std::vector<UncalibratedScene> metric_candidates(const ProjectiveScene& scene, const ObservationIndex& index,
                                                 bool equal_lenses, int count);

}  // namespace raysfm
