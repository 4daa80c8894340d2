#pragma once

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"

namespace raysfm {

// How well one camera stands for another, over the pixels that were compared.
struct RayFit {
  Camera camera;
  int samples = 0;
  double rms_px = 0;  // angle between the rays, in pixels of the first camera there
  double max_px = 0;
  double max_origin = 0;  // between the rays at the pixel's own origin, in the rig's length unit; central: 0
};

// The ray table that comes nearest to a camera of any model: least squares on the rays of a regular grid of
// sub-pixel positions, four by four in each cell. Central where the camera's model is.
//
// grid_width x grid_height control points, 4 to 1024 each, over the whole image; 0: one for about every
// 16 pixels. The pixels of a cell that see nothing do not take part; control points that no seeing pixel
// needs are marked as seeing nothing. At the border of what the camera sees, the table sees up to about a
// cell more: masks go with it as they do with the camera.
//
// Compared at positions halfway between those fitted. kBadInput where the camera sees nothing or a size is
// out of range.
Result<RayFit> fit_ray_table(const Camera& camera, int grid_width = 0, int grid_height = 0);

}  // namespace raysfm
