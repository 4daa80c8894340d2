#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/mesh/surface_mesh.h"
#include "raysfm/mesh/surface_points.h"
#include "raysfm/mesh/tetrahedra.h"

namespace raysfm {

// Which part of space is empty, and the surface of it.
struct SpaceDivision {
  Tetrahedra tetrahedra;
  std::vector<SurfacePoint> points;  // by vertex of `tetrahedra` less its corners
  std::vector<uint8_t> is_outside;   // by tetrahedron: empty space
  std::vector<int> rays;             // by tetrahedron: how many rays went through
  SurfaceMesh surface;               // faces between outside and inside; closed with the border of the box
  std::vector<int> outer_cell;       // by face of `surface`: the tetrahedron before it
};

// A surface with what it was made from.
struct SceneSurface {
  SpaceDivision space;
  SurfaceMesh mesh;  // a part of that of `space`
};

// Divides the space about `points`, which are in descending order of what they are worth, into empty and full
// by the rays that see them (Labatut, Pons and Keriven 2007): a minimal cut of Delaunay tetrahedra, where
// what a ray goes through before its point costs if it is full, what lies just behind the point costs if it
// is empty, and faces whose tetrahedra are flat cost something anyway. Points that stand closer together than
// they are known become one, with the rays of both. `points` must not be empty.
SpaceDivision divide_space(std::span<const SurfacePoint> points);

}  // namespace raysfm
