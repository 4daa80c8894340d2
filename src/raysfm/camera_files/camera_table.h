#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/files/config_field.h"

namespace raysfm {

// Ray tables in files: the project's own and those of puzzlepaint's tool.

enum class Holes { kRefused, kAllowed };  // control points ~, ~, ~ where nothing is seen

// The control points of a grid whose size is known: grid_width * grid_height triples x, y, z in one list, row
// by row. Directions of length zero and numbers that are not finite are reported.
void read_control_points(const ConfigField& field, Holes holes, const RayGridData& grid,
                         std::vector<Eigen::Vector3d>* points);

// The table of a grid; what makes none is reported to `field`.
CameraModel make_table(RayGridData grid, const ConfigField& field);

// The map `table` of the project's camera file: area [min_x, min_y, max_x, max_y] in pixels, grid [width,
// height], directions and, for a non-central camera, points.
CameraModel read_table(const ConfigField& field);
std::string format_table(const RayGridData& grid);

// The table of a camera, or null where it is none.
const RayGridData* table_of(const CameraModel& model);

}  // namespace raysfm
