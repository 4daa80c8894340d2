#include "raysfm/models/ray_table.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "raysfm/models/cubic_weights.h"

namespace raysfm {
namespace {

// A pixel's place in the grid.
struct GridPosition {
  size_t first;             // control point at the top left of the sixteen
  double tx, ty;            // fraction of the cell
  double scale_x, scale_y;  // cells per pixel
};

bool locate(const RayGridData& grid, const Eigen::Vector2d& pixel, GridPosition* position) {
  position->scale_x = (grid.grid_width - 3.0) / (grid.max_x + 1.0 - grid.min_x);
  position->scale_y = (grid.grid_height - 3.0) / (grid.max_y + 1.0 - grid.min_y);
  const double x = (pixel.x() + 0.5 - grid.min_x) * position->scale_x;
  const double y = (pixel.y() + 0.5 - grid.min_y) * position->scale_y;
  const int columns = grid.grid_width - 3, rows = grid.grid_height - 3;
  if (!(x >= 0 && x <= columns && y >= 0 && y <= rows)) return false;
  const int column = std::min(static_cast<int>(x), columns - 1),
            row = std::min(static_cast<int>(y), rows - 1);
  position->first = static_cast<size_t>(row) * grid.grid_width + column;
  position->tx = x - column;
  position->ty = y - row;
  return true;
}

// Value of the spline and, where wanted, its derivative by the pixel. Not finite where it sees nothing.
Eigen::Vector3d evaluate(const RayGridData& grid, const std::vector<Eigen::Vector3d>& control,
                         const GridPosition& position, Eigen::Matrix<double, 3, 2>* jacobian) {
  const CubicWeights wx(position.tx), wy(position.ty);
  Eigen::Vector3d value = Eigen::Vector3d::Zero(), by_x = value, by_y = value;
  for (int j = 0; j < 4; ++j) {
    const Eigen::Vector3d* p = control.data() + position.first + static_cast<size_t>(j) * grid.grid_width;
    const Eigen::Vector3d row =
        wx.value[0] * p[0] + wx.value[1] * p[1] + wx.value[2] * p[2] + wx.value[3] * p[3];
    value += wy.value[j] * row;
    if (!jacobian) continue;
    by_y += wy.slope[j] * row;
    by_x += wy.value[j] * (wx.slope[0] * p[0] + wx.slope[1] * p[1] + wx.slope[2] * p[2] + wx.slope[3] * p[3]);
  }
  if (jacobian) *jacobian << position.scale_x * by_x, position.scale_y * by_y;
  return value;
}

bool direction_at(const RayGridData& grid, const GridPosition& position, Eigen::Vector3d* direction,
                  Eigen::Matrix<double, 3, 2>* jacobian) {
  const Eigen::Vector3d value = evaluate(grid, grid.directions, position, jacobian);
  const double length = value.norm();
  if (!(length > 1e-9) || !std::isfinite(length)) return false;
  *direction = value / length;
  if (jacobian) {
    *jacobian /= length;
    *jacobian -= *direction * (direction->transpose() * *jacobian).eval();
  }
  return true;
}

Error refused(const std::string& field, long long value, const std::string& allowed) {
  return bad_input(field + " " + std::to_string(value) + ": " + allowed);
}

std::shared_ptr<const RayGridData> checked(RayGridData data, bool with_points) {
  if (!check_ray_grid(data) || data.points.empty() == with_points) return nullptr;
  return std::make_shared<const RayGridData>(std::move(data));
}

}  // namespace

Result<void> check_ray_grid(const RayGridData& data) {
  constexpr int kMaxPixel = 1 << 20;
  for (const auto& [name, value] :
       {std::pair{"calibration_min_x", data.min_x}, {"calibration_min_y", data.min_y}}) {
    if (std::abs(static_cast<long long>(value)) > kMaxPixel)
      return refused(name, value, "between -1048576 and 1048576");
  }
  if (data.max_x < data.min_x || data.max_x > kMaxPixel) {
    return refused("calibration_max_x", data.max_x, "at least calibration_min_x, at most 1048576");
  }
  if (data.max_y < data.min_y || data.max_y > kMaxPixel) {
    return refused("calibration_max_y", data.max_y, "at least calibration_min_y, at most 1048576");
  }
  for (const auto& [name, value] :
       {std::pair{"grid_width", data.grid_width}, {"grid_height", data.grid_height}}) {
    if (value < 4 || value > kMaxControlPoints)
      return refused(name, value, "at least 4, with at most 4194304 points in all");
  }
  const int64_t count = int64_t{data.grid_width} * data.grid_height;
  if (count > kMaxControlPoints)
    return refused("grid_height", data.grid_height, "at most 4194304 points in all");
  if (static_cast<int64_t>(data.directions.size()) != count) {
    return refused("directions", static_cast<long long>(data.directions.size()),
                   "grid_width * grid_height of them");
  }
  if (!data.points.empty() && static_cast<int64_t>(data.points.size()) != count) {
    return refused("points", static_cast<long long>(data.points.size()),
                   "none, or grid_width * grid_height of them");
  }
  return {};
}

CentralRayTable::CentralRayTable(RayGridData data) : data_(checked(std::move(data), false)) {}

bool CentralRayTable::unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction,
                                Eigen::Matrix<double, 3, 2>* jacobian) const {
  GridPosition position;
  return data_ && locate(*data_, pixel, &position) && direction_at(*data_, position, direction, jacobian);
}

NonCentralRayTable::NonCentralRayTable(RayGridData data) : data_(checked(std::move(data), true)) {}

bool NonCentralRayTable::ray(const Eigen::Vector2d& pixel, Ray* ray,
                             Eigen::Matrix<double, 6, 2>* jacobian) const {
  GridPosition position;
  if (!data_ || !locate(*data_, pixel, &position)) return false;
  Eigen::Matrix<double, 3, 2> by_pixel;
  if (!direction_at(*data_, position, &ray->direction, jacobian ? &by_pixel : nullptr)) return false;
  if (jacobian) jacobian->bottomRows<3>() = by_pixel;
  ray->origin = evaluate(*data_, data_->points, position, jacobian ? &by_pixel : nullptr);
  if (jacobian) jacobian->topRows<3>() = by_pixel;
  return ray->origin.allFinite();
}

}  // namespace raysfm
