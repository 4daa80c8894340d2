#pragma once

#include <Eigen/Core>
#include <memory>
#include <string_view>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/models/model.h"

namespace raysfm {

// The numbers of a ray table, the generic models of Schoeps, Larsson, Pollefeys and Sattler (2020): a grid of
// control points of a uniform cubic B-spline over a rectangle of the image.
//
// The rectangle holds the pixels min_x..max_x, min_y..max_y, all of each pixel. The grid extends one cell
// beyond it on every side: with u the pixel coordinate, pixel centres at integers,
//
//   gx = 1 + (grid_width - 3) (u + 0.5 - min_x) / (max_x + 1 - min_x),  gy likewise,
//
// is the position in the grid, whose control points have integer coordinates; point (i, j) is element
// i + grid_width j. The direction of a ray is the normalised value of the spline of the directions, its
// origin the value of the spline of the points. Control points that are not finite mark where nothing is
// seen: a pixel whose 4 x 4 control points are not all finite has no ray.
struct RayGridData {
  int min_x = 0, min_y = 0, max_x = 0, max_y = 0;  // pixels
  int grid_width = 0, grid_height = 0;             // control points, at least 4
  std::vector<Eigen::Vector3d> directions;         // grid_width * grid_height
  std::vector<Eigen::Vector3d> points;             // as many, or none: a central camera
};

// Largest number of control points of a table.
inline constexpr int kMaxControlPoints = 1 << 22;

// The first thing about the numbers that makes no table, as one line "<field> <value>: <what is allowed>".
Result<void> check_ray_grid(const RayGridData& data);

// A camera that is a table of rays: it fits any camera, central or not, and cannot project. Copies share the
// table. A table made of numbers that check_ray_grid() refuses, as one made of nothing, sees nothing.
class CentralRayTable {
 public:
  static constexpr std::string_view kName = "ray-table";

  CentralRayTable() = default;
  explicit CentralRayTable(RayGridData data);

  // `jacobian`, when not null, is d direction / d pixel.
  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction,
                 Eigen::Matrix<double, 3, 2>* jacobian) const;
  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
    return unproject(pixel, direction, nullptr);
  }

  // Null for a table of nothing.
  const RayGridData* data() const { return data_.get(); }

 private:
  std::shared_ptr<const RayGridData> data_;
};

// The same with an origin for every ray.
class NonCentralRayTable {
 public:
  static constexpr std::string_view kName = "ray-table";

  NonCentralRayTable() = default;
  explicit NonCentralRayTable(RayGridData data);

  // `jacobian`, when not null, is d (origin, direction) / d pixel.
  bool ray(const Eigen::Vector2d& pixel, Ray* ray, Eigen::Matrix<double, 6, 2>* jacobian) const;
  bool ray(const Eigen::Vector2d& pixel, Ray* ray) const { return this->ray(pixel, ray, nullptr); }

  const RayGridData* data() const { return data_.get(); }

 private:
  std::shared_ptr<const RayGridData> data_;
};

static_assert(CentralModel<CentralRayTable> && !ProjectiveModel<CentralRayTable>);
static_assert(NonCentralModel<NonCentralRayTable> && !CentralModel<NonCentralRayTable>);

}  // namespace raysfm
