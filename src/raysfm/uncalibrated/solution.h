#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/lenses/lens_adjustment.h"
#include "raysfm/projective/projective_start.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// Tracks in units of half the image's larger side about its centre.
struct Units {
  double scale;
  Eigen::Vector2d centre;

  explicit Units(const PointTracks& tracks)
      : scale(0.5 * tracks.image_size.maxCoeff()), centre(tracks.centre()) {}
  PointTracks apply(const PointTracks& tracks) const;
  Lens undo(const Lens& lens) const;
};

// A scene while it is being found, with what it was found from.
struct Solution {
  UncalibratedScene scene;
  LensAdjustmentSummary summary;
  std::vector<uint8_t> inlier;
  std::vector<uint8_t> image_posed, point_placed;  // looked at by settle()
  int start_images[2] = {-1, -1};
  int start_inliers = 0;
};

// The error of whatever the caller asked to end.
Error interrupted();

// Projective start from the pair of this rank. Errors: as projective_start().
Result<ProjectiveStart> start_of(const PointTracks& tracks, const Units& units, const SolveOptions& options,
                                 int rank = 0);

// Metric scenes of all images and points; what is not posed or placed is zero.
std::vector<UncalibratedScene> metric_starts(const PointTracks& tracks, const Units& units,
                                             const ProjectiveStart& start, bool equal);

// Marks the observations, of images posed and points placed, that a scene and a distortion agree with.
std::vector<uint8_t> agreeing_observations(const PointTracks& tracks, const UncalibratedScene& scene,
                                           const RadialDistortion& radial, std::span<const uint8_t> posed,
                                           std::span<const uint8_t> placed, double max_error_px);

// Adjusts with the observations that agree with the scene, and judges them anew. `equal`: one lens for all
// images; else those of one number of options.lens_of_image have one. Errors: as adjust_standard().
Result<void> settle(const PointTracks& tracks, const SolveOptions& options, bool equal, Solution* solution);

// The self-calibration that ends in the least cost, adjusted again with the observations that then agree with
// it. kNoReconstruction where there is none, or interrupted.
Result<Solution> best_solution(const PointTracks& tracks, const ProjectiveStart& start, const Units& units,
                               const SolveOptions& options, bool equal);

// What the inliers of images and points that have enough of them say.
UncalibratedReconstruction filled(const PointTracks& tracks, Solution solution);

}  // namespace raysfm
