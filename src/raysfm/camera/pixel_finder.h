#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/camera/camera.h"

namespace raysfm {

// Where a camera sees a point, whatever its model: the projection where it has one, else a search over its
// rays: a ray near the point from a table, then Newton's method on the angle between ray and point.
//
// A model that cannot project sees a point where a ray passes through it. The pixel found is accurate to
// 1e-6 px. Thread-safe, no allocation in find().
class PixelFinder {
 public:
  // Copies the camera. For a camera that cannot project, computes a coarse grid of its rays, some 10 ms.
  explicit PixelFinder(const Camera& camera);

  // Pixel of a point in the camera's frame, like Camera::project(). `jacobian`, when not null, is
  // d pixel / d point. False, leaving the outputs unspecified, where the camera does not see the point.
  bool find(const Eigen::Vector3d& point_in_cam, Eigen::Vector2d* pixel,
            Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;

 private:
  static constexpr int kGrid = 32;  // rays per axis
  static constexpr int kCube = 16;  // directions per axis on each side of a cube

  void tabulate_rays();
  void tabulate_directions();
  void score(const Eigen::Vector3f& point, float* scores) const;
  bool search(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
              Eigen::Matrix<double, 2, 3>* jacobian) const;
  bool search_all(const Eigen::Vector3d& point, int tried, Eigen::Vector2d* pixel,
                  Eigen::Matrix<double, 2, 3>* jacobian) const;
  bool solve_from(int ray, const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                  Eigen::Matrix<double, 2, 3>* jacobian) const;
  Eigen::Vector2d grid_pixel(int ray) const;

  // Change of a ray's direction and origin with its pixel.
  struct Slope {
    Eigen::Matrix<float, 3, 2> direction = Eigen::Matrix<float, 3, 2>::Zero();
    Eigen::Matrix<float, 3, 2> origin = Eigen::Matrix<float, 3, 2>::Zero();
  };
  bool slope_at(const Eigen::Vector2d& pixel, const Ray& ray, Slope* slope) const;

  Camera camera_;
  bool projects_ = true;
  // The grid of rays, row by row, one array for each coordinate; directions are zero where nothing is seen.
  std::vector<float> ox_, oy_, oz_, dx_, dy_, dz_;
  std::vector<Slope> slopes_;      // of each ray of the grid
  std::vector<float> min_cosine_;  // of the angle to a point that a pixel near this ray can see
  std::vector<int> nearest_;       // ray nearest to each direction of the cube; -1: there are no rays
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();  // mean of the origins
  double spread_ = 0;                                 // largest distance of an origin from it
};

}  // namespace raysfm
