#include "raysfm/mesh/mesh_views.h"

#include <optional>

#include "raysfm/scene/frame_lens.h"

namespace raysfm {

MeshViews::MeshViews(const MeshScene& scene) : scene_(scene) {
  for (const Camera& camera : scene.cameras) {
    finders_.emplace_back(camera);
    const std::optional<Lens> lens = lens_of(camera);
    fy_and_cy_.emplace_back(lens ? Eigen::Vector2d(lens->vector()[1], lens->vector()[3])
                                 : Eigen::Vector2d(1, 0));
  }
  for (const MeshView& view : scene.views) cam_from_world_.push_back(view.world_from_cam.inverse());
}

double MeshViews::skew_shift(int camera, double v) const {
  return scene_.skews[camera] * (v - fy_and_cy_[camera].y()) / fy_and_cy_[camera].x();
}

bool MeshViews::pixel(int view, const Eigen::Vector3d& point, Eigen::Vector2d* pixel) const {
  const int camera = scene_.views[view].camera;
  if (!finders_[camera].find(cam_from_world_[view] * point, pixel)) return false;
  pixel->x() += skew_shift(camera, pixel->y());
  return scene_.cameras[camera].contains(*pixel);
}

bool MeshViews::eye(int view, const Eigen::Vector2d& pixel, Eigen::Vector3d* eye) const {
  const int camera = scene_.views[view].camera;
  Ray ray;
  if (!scene_.cameras[camera].ray({pixel.x() - skew_shift(camera, pixel.y()), pixel.y()}, &ray)) return false;
  *eye = scene_.views[view].world_from_cam * ray.origin;
  return true;
}

}  // namespace raysfm
