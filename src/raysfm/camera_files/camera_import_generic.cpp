#include <fmt/format.h>

#include "raysfm/camera_files/camera_import.h"
#include "raysfm/camera_files/camera_table.h"

namespace raysfm {

Rig import_generic(const ConfigField& root) {
  const ConfigField type = root.at("type");
  const bool central = type.text() == "CentralGenericModel";
  if (!central && type.text() != "NoncentralGenericModel") {
    type.report("CentralGenericModel, NoncentralGenericModel");
    return {};
  }
  Camera camera;
  camera.name = "camera";
  camera.width = root.at("width").integer(1, kMaxImageSide);
  camera.height = root.at("height").integer(1, kMaxImageSide);
  RayGridData grid;
  grid.min_x = root.at("calibration_min_x").integer(0, camera.width - 1);
  grid.min_y = root.at("calibration_min_y").integer(0, camera.height - 1);
  grid.max_x = root.at("calibration_max_x").integer(0, camera.width - 1);
  grid.max_y = root.at("calibration_max_y").integer(0, camera.height - 1);
  grid.grid_width = root.at("grid_width").integer(4, kMaxImageSide);
  grid.grid_height = root.at("grid_height").integer(4, kMaxImageSide);
  if (root.problem().any()) return {};
  read_control_points(root.at(central ? "grid" : "direction_grid"), Holes::kRefused, grid, &grid.directions);
  if (!central) read_control_points(root.at("point_grid"), Holes::kRefused, grid, &grid.points);
  camera.model = make_table(std::move(grid), root);
  return Rig{{std::move(camera)}};
}

}  // namespace raysfm
