#include "raysfm/camera_files/camera_table.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "raysfm/camera_files/camera_import.h"

namespace raysfm {

void read_control_points(const ConfigField& field, Holes holes, const RayGridData& grid,
                         std::vector<Eigen::Vector3d>* points) {
  const size_t count = static_cast<size_t>(grid.grid_width) * grid.grid_height;
  const std::vector<double> numbers = holes == Holes::kAllowed ? field.numbers_or_holes() : field.numbers();
  if (numbers.size() != 3 * count) {
    field.problem().report(
        field.name(), fmt::format("{} numbers", numbers.size()),
        fmt::format("3 * {} * {} = {}, as grid says", grid.grid_width, grid.grid_height, 3 * count));
    return;
  }
  points->resize(count);
  for (size_t i = 0; i < count; ++i) (*points)[i] = {numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]};
}

CameraModel make_table(RayGridData grid, const ConfigField& field) {
  if (field.problem().any()) return Pinhole{};
  for (size_t i = 0; i < grid.directions.size(); ++i) {
    if (!grid.directions[i].isZero()) continue;
    field.problem().report(field.name().empty() ? "grid" : field.name(),
                           fmt::format("direction {} of length 0", i), "directions of any other length");
    return Pinhole{};
  }
  const Result<void> good = check_ray_grid(grid);
  if (!good) {
    field.problem().report(field.name().empty() ? "grid" : field.name(), good.error().message,
                           "a grid of rays");
    return Pinhole{};
  }
  if (grid.points.empty()) return CentralRayTable(std::move(grid));
  return NonCentralRayTable(std::move(grid));
}

CameraModel read_table(const ConfigField& field) {
  field.allow_only({"area", "grid", "directions", "points"});
  const std::vector<ConfigField> area = field.at("area").list();
  const std::vector<ConfigField> size = field.at("grid").list();
  if (area.size() != 4) field.at("area").report("[min_x, min_y, max_x, max_y]");
  if (size.size() != 2) field.at("grid").report("[width, height]");
  if (field.problem().any()) return Pinhole{};
  RayGridData grid;
  grid.min_x = area[0].integer(0, kMaxImageSide);
  grid.min_y = area[1].integer(0, kMaxImageSide);
  grid.max_x = area[2].integer(0, kMaxImageSide);
  grid.max_y = area[3].integer(0, kMaxImageSide);
  grid.grid_width = size[0].integer(4, kMaxImageSide);
  grid.grid_height = size[1].integer(4, kMaxImageSide);
  if (field.problem().any()) return Pinhole{};
  read_control_points(field.at("directions"), Holes::kAllowed, grid, &grid.directions);
  if (field.at("points").exists())
    read_control_points(field.at("points"), Holes::kAllowed, grid, &grid.points);
  return make_table(std::move(grid), field);
}

namespace {

std::string format_points(const char* name, const std::vector<Eigen::Vector3d>& points, int per_line) {
  std::string text = fmt::format("      {}: [", name);
  for (size_t i = 0; i < points.size(); ++i) {
    if (i > 0) text += i % per_line == 0 ? ",\n        " : ", ";
    text += points[i].allFinite() ? fmt::format("{}, {}, {}", points[i].x(), points[i].y(), points[i].z())
                                  : "~, ~, ~";
  }
  return text + "]\n";
}

}  // namespace

std::string format_table(const RayGridData& grid) {
  std::string text =
      fmt::format("    table:\n      area: [{}, {}, {}, {}]\n      grid: [{}, {}]\n", grid.min_x, grid.min_y,
                  grid.max_x, grid.max_y, grid.grid_width, grid.grid_height);
  text += format_points("directions", grid.directions, grid.grid_width);
  if (!grid.points.empty()) text += format_points("points", grid.points, grid.grid_width);
  return text;
}

const RayGridData* table_of(const CameraModel& model) {
  if (const auto* central = std::get_if<CentralRayTable>(&model)) return central->data();
  if (const auto* other = std::get_if<NonCentralRayTable>(&model)) return other->data();
  return nullptr;
}

}  // namespace raysfm
