#pragma once

#include <vector>

#include "raysfm/core/thread_pool.h"
#include "raysfm/mesh/mesh_surface.h"
#include "raysfm/mesh/mesh_views.h"

namespace raysfm {

// For each face of the mesh the view that shows it best, -1 where none does: all of it in the image, from its
// front, with nothing before it, and as large as may be; where neighbours have another view that is nearly as
// good, theirs. Bit-identical for any number of threads.
std::vector<int> choose_face_views(const SceneSurface& surface, const MeshViews& views, ThreadPool& pool);

}  // namespace raysfm
