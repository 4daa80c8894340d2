#include "raysfm/mesh/sight_walk.h"

#include <limits>

namespace raysfm {
namespace {

constexpr int kMostCells = 1 << 20;  // of a walk; rounding may lead it in circles about an edge

}  // namespace

SightWalk::SightWalk(const Tetrahedra& tetrahedra, int cell, const Eigen::Vector3d& from,
                     const Eigen::Vector3d& to)
    : tetrahedra_(tetrahedra), from_(from), direction_(to - from), cell_(cell) {}

// Out of the tetrahedron by the face whose plane comes first of those that the direction leads out of.
bool SightWalk::next() {
  const Tetrahedron& here = tetrahedra_.cells()[cell_];
  Eigen::Vector3d corners[4];
  for (int k = 0; k < 4; ++k) corners[k] = tetrahedra_.position(here.vertices[k]) - from_;
  int exit = -1;
  double nearest = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 4; ++i) {
    const int* f = kFaceVertices[i];
    const Eigen::Vector3d normal = (corners[f[1]] - corners[f[0]]).cross(corners[f[2]] - corners[f[0]]);
    // Outwards: away from the vertex opposite.
    const double side = normal.dot(corners[i] - corners[f[0]]) > 0 ? -1 : 1;
    const double speed = side * normal.dot(direction_);
    if (!(speed > 0) || (here.neighbours[i] >= 0 && here.neighbours[i] == left_cell_)) continue;
    const double at = side * normal.dot(corners[f[0]]) / speed;
    if (at < nearest) nearest = at, exit = i;
  }
  if (exit < 0 || nearest >= 1 || here.neighbours[exit] < 0 || ++steps_ > kMostCells) return false;
  left_cell_ = cell_;
  left_face_ = exit;
  at_ = nearest;
  cell_ = here.neighbours[exit];
  return true;
}

}  // namespace raysfm
