#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "raysfm/mesh/surface_points.h"
#include "raysfm/mesh/visibility_surface.h"

namespace raysfm {

// A surface with what is known about it.
struct SceneSurface {
  SpaceDivision space;  // `surface` is that of all of space
  SurfaceMesh mesh;     // what of it the cameras vouch for; may be empty
};

// The surface of a scene: that of divide_space() without the border of the box, without faces that are much
// larger than those about them where no ray was behind them (the sky between two roofs), and without pieces
// that are small beside the largest one; smoothed within the standard deviations of its points.
SceneSurface scene_surface(std::vector<SurfacePoint> points);

}  // namespace raysfm
