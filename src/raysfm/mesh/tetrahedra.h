#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "raysfm/mesh/grid_predicates.h"

namespace raysfm {

// Four vertices of positive orientation(); neighbour i lies beyond the face opposite to vertex i, -1 outside
// the box. Vertices of -1: not in use.
struct Tetrahedron {
  std::array<int, 4> vertices = {-1, -1, -1, -1};
  std::array<int, 4> neighbours = {-1, -1, -1, -1};
};

// Delaunay tetrahedra of points in a box, whose eight corners are vertices 0 to 7. Points are rounded to a
// grid of kGridSide steps along the longest side of the box, on which all decisions are exact: what is built
// is the Delaunay tetrahedralisation of the rounded points, whatever they are. The order of the points
// decides among cospherical ones alone.
class Tetrahedra {
 public:
  static constexpr int kCorners = 8;

  // `box` must not be empty, and finite.
  explicit Tetrahedra(const Eigen::AlignedBox3d& box);

  // Whether a point may be added, or located: inside the box, and not on its border.
  bool contains(const Eigen::Vector3d& point) const;

  // Adds a point that the box contains: its number, or that of a vertex at the same place of the grid. A
  // point that lies in the plane of a face about it, exactly, is moved by a step or two of the grid; -1 where
  // that does not help, which needs a few thousand points in one place.
  int add(const Eigen::Vector3d& point);

  // The tetrahedron about a point that the box contains.
  int locate(const Eigen::Vector3d& point) const { return locate(rounded(point), hint(rounded(point))); }
  // One of the tetrahedra about a vertex.
  int cell_of(int vertex) const { return cell_of_[vertex]; }

  // Position of a vertex, rounded to the grid.
  Eigen::Vector3d position(int vertex) const;
  int vertex_count() const { return static_cast<int>(points_.size()); }

  // All tetrahedra; they fill the box.
  const std::vector<Tetrahedron>& cells() const { return cells_; }

 private:
  struct CavityFace {
    int cell, face, outside;
  };

  GridPoint rounded(const Eigen::Vector3d& point) const;
  int hint_slot(const GridPoint& point) const;
  int hint(const GridPoint& point) const { return hints_[hint_slot(point)]; }
  int locate(const GridPoint& point, int from) const;
  bool in_conflict(int cell, const GridPoint& point) const;
  bool find_cavity(const GridPoint& point, int cell);
  void fill_cavity(int vertex);
  void connect(int cell, int face, int vertex);
  int take_cell();

  Eigen::Vector3d low_;
  double step_ = 1;
  std::vector<GridPoint> points_;
  std::vector<Tetrahedron> cells_;
  std::vector<int> cell_of_;  // by vertex
  std::vector<int> hints_;    // a cell near each part of the box
  std::vector<int> unused_;   // cells
  // Of the point that is being added.
  std::vector<int> cavity_;
  std::vector<CavityFace> border_;
  std::vector<uint8_t> in_cavity_;  // by cell
  struct OpenFace {
    uint64_t edge;
    int cell, face;
  };
  std::vector<OpenFace> open_;
};

// Vertices of the face opposite to vertex `i`, in an order that has positive orientation with that vertex
// behind them.
inline constexpr int kFaceVertices[4][3] = {{1, 3, 2}, {0, 2, 3}, {0, 3, 1}, {0, 1, 2}};

}  // namespace raysfm
