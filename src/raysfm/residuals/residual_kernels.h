#pragma once

#include "raysfm/camera/observed_ray.h"
#include "raysfm/residuals/bal_lens.h"
#include "raysfm/residuals/observation_block.h"

namespace raysfm {

// The errors that are computed for eight lanes at once. All read block->x and fill the rest of the
// ResidualBlock.

// A pinhole camera somewhere in the rig: x_in_cam = rotation x_in_rig + translation.
struct PinholeInRig {
  double fx, fy, cx, cy;
  double rotation[9];  // by rows
  double translation[3];
};

// Predicted minus observed pixel; u and v hold eight numbers.
void pinhole_residuals(const PinholeInRig& camera, const double* u, const double* v, ResidualBlock* block);

// The same with Brown's distortion (models/radtan.h).
struct RadtanInRig {
  PinholeInRig pinhole;
  double k1, k2, k3, p1, p2, max_radius2;
};
void radtan_residuals(const RadtanInRig& camera, const double* u, const double* v, ResidualBlock* block);

// Eight observed rays, lane beside lane.
struct alignas(64) RayBlock {
  double origin[3][kBlockLanes];
  double direction[3][kBlockLanes];
  double tangents[6][kBlockLanes];  // by rows
};

// Puts a ray into one lane.
void set_ray(const ObservedRay& ray, size_t lane, RayBlock* block);

// The angular error of camera/observed_ray.h.
void angular_residuals(const RayBlock& rays, ResidualBlock* block);

// Predicted minus observed pixel of a lens; fills block->lens as well.
void lens_residuals(const BalLens& lens, const double* u, const double* v, ObservationBlock<9>* block);

}  // namespace raysfm
