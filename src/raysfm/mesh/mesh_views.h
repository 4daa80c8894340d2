#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/camera/pixel_finder.h"
#include "raysfm/mesh/surface_points.h"

namespace raysfm {

// Where the views of a scene see points of the world, whatever their cameras. Thread-safe.
class MeshViews {
 public:
  // `scene` must outlive it.
  explicit MeshViews(const MeshScene& scene);

  int count() const { return static_cast<int>(scene_.views.size()); }
  const Camera& camera(int view) const { return scene_.cameras[scene_.views[view].camera]; }

  // Pixel of a point; false where the view does not have it in its image.
  bool pixel(int view, const Eigen::Vector3d& point, Eigen::Vector2d* pixel) const;
  // Where the ray of a pixel begins, in the world; false where the pixel sees nothing.
  bool eye(int view, const Eigen::Vector2d& pixel, Eigen::Vector3d* eye) const;

 private:
  double skew_shift(int camera, double v) const;

  const MeshScene& scene_;
  std::vector<PixelFinder> finders_;        // by camera
  std::vector<Eigen::Vector2d> fy_and_cy_;  // of lenses that have a skew
  std::vector<Rigid3> cam_from_world_;      // by view
};

}  // namespace raysfm
