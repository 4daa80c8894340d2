#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/camera/camera.h"

namespace raysfm {

// Where a camera sees a point, whatever its model: the projection where it has one, else a search over its
// rays: the nearest of a coarse grid of rays, then Newton's method on the angle between ray and point.
//
// A model that cannot project sees a point where a ray passes through it. The pixel found is accurate to
// 1e-6 px. Thread-safe, no allocation in find().
class PixelFinder {
 public:
  // Copies the camera. For a camera that cannot project, computes a coarse grid of its rays.
  explicit PixelFinder(const Camera& camera);

  // Pixel of a point in the camera's frame, like Camera::project(). `jacobian`, when not null, is
  // d pixel / d point. False, leaving the outputs unspecified, where the camera does not see the point.
  bool find(const Eigen::Vector3d& point_in_cam, Eigen::Vector2d* pixel,
            Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;

 private:
  static constexpr int kGrid = 32;  // rays per axis

  bool search(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
              Eigen::Matrix<double, 2, 3>* jacobian) const;
  void score(const Eigen::Vector3f& point, float* scores) const;
  Eigen::Vector2d grid_pixel(int index) const;

  Camera camera_;
  bool projects_ = true;
  // The grid of rays, row by row, one array for each coordinate; directions are zero where nothing is seen.
  std::vector<float> ox_, oy_, oz_, dx_, dy_, dz_;
};

}  // namespace raysfm
