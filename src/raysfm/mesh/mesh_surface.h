#pragma once

#include <vector>

#include "raysfm/core/thread_pool.h"
#include "raysfm/mesh/mesh_views.h"
#include "raysfm/mesh/surface_points.h"
#include "raysfm/mesh/visibility_surface.h"

namespace raysfm {

// The surface of a scene: that of divide_space(), less
//  - the border of the box,
//  - faces much longer than the edges about them, as between a roof and the next street,
//  - faces of which no view shows all, the middle unhidden: what closes the surface where nobody has looked,
//  - pieces that are small beside the whole,
// and smoothed within the standard deviations of its points. Every edge has one face or two, every vertex one
// fan of faces; all faces of a piece have their outside on the same side. Empty where nothing is left of it.
// `points` must not be empty. Bit-identical for any number of threads.
SceneSurface scene_surface(const std::vector<SurfacePoint>& points, const MeshViews& views, ThreadPool& pool);

}  // namespace raysfm
