#pragma once

#include <vector>

#include "raysfm/core/thread_pool.h"
#include "raysfm/mesh/mesh_views.h"
#include "raysfm/mesh/visibility_surface.h"

namespace raysfm {

// For each face of the mesh the view that shows it best: all of it in the image, from its front, with nothing
// before it (before its middle, where no view is better), and as large as may be; where neighbours have
// another view that is nearly as good, theirs. -1 where there is none. Bit-identical for any number of
// threads.
std::vector<int> choose_face_views(const SceneSurface& surface, const MeshViews& views, ThreadPool& pool);

// Takes the faces away that have no such view.
void drop_unseen(const MeshViews& views, ThreadPool& pool, SceneSurface* surface);

}  // namespace raysfm
