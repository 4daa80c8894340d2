#pragma once

#include <optional>
#include <span>
#include <vector>

#include "raysfm/lenses/lens_adjustment.h"
#include "raysfm/lenses/radial_distortion.h"

namespace raysfm {

// The pixels that lenses without their distortion would show: those of `tracks` in images that have one.
// Observations of weight 0 stay as they are. `weights` comes back with what makes their residuals comparable
// with those of the pixels as they are.
PointTracks without_distortion(const PointTracks& tracks, std::span<const Lens> lenses,
                               const RadialDistortion& radial, std::vector<double>* weights);

// A coefficient of distortion, with the scene that goes with it.
struct RadialEstimate {
  double k1 = 0, sigma = 0;
  double gain = 0;  // by which it lowers the sum of squares, in units of their variance
  UncalibratedScene scene;
  std::vector<LensVector> lens_by_k1;  // how the lenses change with it, one per image
};

// The coefficient k1, one for all images, with which the standard adjustment from `scene` ends lowest: the
// adjustment is repeated with k1 held, and the vertex of a parabola through the costs is taken. Empty where
// the costs have no minimum.
std::optional<RadialEstimate> estimate_radial(const PointTracks& tracks, std::span<const double> weights,
                                              const LensAdjustmentOptions& options,
                                              const UncalibratedScene& scene);

}  // namespace raysfm
