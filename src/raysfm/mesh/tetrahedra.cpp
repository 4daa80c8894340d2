#include "raysfm/mesh/tetrahedra.h"

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

constexpr int kHintSide = 32;       // parts of the box along an axis
constexpr int kMostNudges = 64;     // before a point is given up
constexpr int kMostSteps = 100000;  // of a walk through the tetrahedra

// A cube in six tetrahedra about its diagonal 0 - 7; corner k has the coordinates of its bits.
constexpr int kCube[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                             {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};

uint64_t edge_key(int a, int b) {
  return (static_cast<uint64_t>(std::min(a, b)) << 32) | static_cast<uint64_t>(std::max(a, b));
}

// Steps of the grid in all directions, farther with each round.
GridPoint nudged(GridPoint point, int attempt) {
  const int direction = attempt % 26 + (attempt % 26 >= 13), reach = 1 + attempt / 26;
  point[0] += reach * (direction % 3 - 1);
  point[1] += reach * (direction / 3 % 3 - 1);
  point[2] += reach * (direction / 9 - 1);
  for (int32_t& x : point) x = std::clamp(x, 1, kGridSide - 2);
  return point;
}

}  // namespace

Tetrahedra::Tetrahedra(const Eigen::AlignedBox3d& box)
    : low_(box.min()),
      step_(box.sizes().maxCoeff() / (kGridSide - 1)),
      hints_(kHintSide * kHintSide * kHintSide) {
  if (!(step_ > 0)) step_ = 1;
  GridPoint high;
  for (int k = 0; k < 3; ++k) {
    high[k] = std::clamp(static_cast<int32_t>(std::ceil(box.sizes()[k] / step_)), 2, kGridSide - 1);
  }
  for (int corner = 0; corner < kCorners; ++corner) {
    points_.push_back({corner & 1 ? high[0] : 0, corner & 2 ? high[1] : 0, corner & 4 ? high[2] : 0});
  }
  cell_of_.assign(kCorners, 0);
  for (const auto& corners : kCube) {
    Tetrahedron& cell = cells_.emplace_back();
    std::copy(std::begin(corners), std::end(corners), cell.vertices.begin());
    if (orientation(points_[corners[0]], points_[corners[1]], points_[corners[2]], points_[corners[3]]) < 0) {
      std::swap(cell.vertices[0], cell.vertices[1]);
    }
  }
  for (int a = 0; a < 6; ++a) {
    for (const int v : cells_[a].vertices) cell_of_[v] = a;
    for (int b = 0; b < 6; ++b) {
      // Two tetrahedra that share three vertices are neighbours, opposite to the fourth.
      const std::array<int, 4>& theirs = cells_[b].vertices;
      const auto is_own = [&](int v) { return std::ranges::find(theirs, v) == theirs.end(); };
      if (a == b || std::ranges::count_if(cells_[a].vertices, is_own) != 1) continue;
      cells_[a].neighbours[std::ranges::find_if(cells_[a].vertices, is_own) - cells_[a].vertices.begin()] = b;
    }
  }
  in_cavity_.assign(cells_.size(), 0);
}

bool Tetrahedra::contains(const Eigen::Vector3d& point) const {
  for (int k = 0; k < 3; ++k) {
    const double at = (point[k] - low_[k]) / step_;
    if (!(at >= 1 && at <= points_[kCorners - 1][k] - 1)) return false;
  }
  return true;
}

GridPoint Tetrahedra::rounded(const Eigen::Vector3d& point) const {
  GridPoint grid;
  for (int k = 0; k < 3; ++k) grid[k] = static_cast<int32_t>(std::lround((point[k] - low_[k]) / step_));
  return grid;
}

Eigen::Vector3d Tetrahedra::position(int vertex) const {
  const GridPoint& p = points_[vertex];
  return low_ + step_ * Eigen::Vector3d(p[0], p[1], p[2]);
}

int Tetrahedra::hint_slot(const GridPoint& point) const {
  const auto part = [](int32_t x) { return static_cast<int>(int64_t{x} * kHintSide / kGridSide); };
  return part(point[0]) + kHintSide * (part(point[1]) + kHintSide * part(point[2]));
}

// Towards the point, from neighbour to neighbour; that this ends is a property of Delaunay tetrahedra.
int Tetrahedra::locate(const GridPoint& point, int from) const {
  int cell = from;
  for (int step = 0; step < kMostSteps; ++step) {
    const Tetrahedron& here = cells_[cell];
    int next = -1;
    for (int k = 0; k < 4 && next < 0; ++k) {
      const int i = (k + step) % 4;
      if (here.neighbours[i] < 0) continue;
      const int* f = kFaceVertices[i];
      const int side = orientation(points_[here.vertices[f[0]]], points_[here.vertices[f[1]]],
                                   points_[here.vertices[f[2]]], point);
      if (side < 0) next = here.neighbours[i];
    }
    if (next < 0) break;
    cell = next;
  }
  return cell;
}

bool Tetrahedra::in_conflict(int cell, const GridPoint& point) const {
  const std::array<int, 4>& v = cells_[cell].vertices;
  return in_sphere(points_[v[0]], points_[v[1]], points_[v[2]], points_[v[3]], point) > 0;
}

// The tetrahedra whose spheres hold the point, and the faces about them. False, where the point lies in the
// plane of one of these.
bool Tetrahedra::find_cavity(const GridPoint& point, int cell) {
  cavity_.assign(1, cell);
  border_.clear();
  in_cavity_[cell] = 1;
  bool is_general = true;
  for (size_t i = 0; i < cavity_.size(); ++i) {
    for (int k = 0; k < 4; ++k) {
      const Tetrahedron& here = cells_[cavity_[i]];
      const int next = here.neighbours[k];
      if (next >= 0 && in_cavity_[next]) continue;
      if (next >= 0 && in_conflict(next, point)) {
        in_cavity_[next] = 1;
        cavity_.push_back(next);
        continue;
      }
      border_.push_back({cavity_[i], k, next});
    }
  }
  for (const CavityFace& face : border_) {
    const Tetrahedron& here = cells_[face.cell];
    const int* f = kFaceVertices[face.face];
    is_general &= orientation(points_[here.vertices[f[0]]], points_[here.vertices[f[1]]],
                              points_[here.vertices[f[2]]], point) > 0;
  }
  for (const int c : cavity_) in_cavity_[c] = 0;
  return is_general;
}

int Tetrahedra::take_cell() {
  if (!unused_.empty()) {
    const int cell = unused_.back();
    unused_.pop_back();
    return cell;
  }
  cells_.emplace_back();
  in_cavity_.push_back(0);
  return static_cast<int>(cells_.size()) - 1;
}

// Face `face` of `cell` has the new vertex and one edge of the border, which one other such face shares.
void Tetrahedra::connect(int cell, int face, int vertex) {
  int ends[2], count = 0;
  for (const int k : kFaceVertices[face]) {
    if (cells_[cell].vertices[k] != vertex) ends[count++] = cells_[cell].vertices[k];
  }
  open_.push_back({edge_key(ends[0], ends[1]), cell, face});
}

// Tetrahedra from the faces of the border to the new vertex take the place of those of the cavity.
void Tetrahedra::fill_cavity(int vertex) {
  std::vector<Tetrahedron> made;
  made.reserve(border_.size());
  for (const CavityFace& face : border_) {
    Tetrahedron& cell = made.emplace_back();
    cell.vertices = cells_[face.cell].vertices;
    cell.vertices[face.face] = vertex;
    cell.neighbours[face.face] = face.outside;
  }
  for (const int cell : cavity_) cells_[cell] = {};
  unused_.insert(unused_.end(), cavity_.rbegin(), cavity_.rend());
  open_.clear();
  for (size_t i = 0; i < made.size(); ++i) {
    const int cell = take_cell();
    cells_[cell] = made[i];
    const int outside = border_[i].outside;
    if (outside >= 0) {
      // The face of the neighbour that the old cell was beyond: opposite to the vertex that is not shared.
      for (int k = 0; k < 4; ++k) {
        if (std::ranges::find(made[i].vertices, cells_[outside].vertices[k]) == made[i].vertices.end()) {
          cells_[outside].neighbours[k] = cell;
        }
      }
    }
    for (int k = 0; k < 4; ++k) {
      cell_of_[made[i].vertices[k]] = cell;
      if (k != border_[i].face) connect(cell, k, vertex);
    }
    hints_[hint_slot(points_[vertex])] = cell;
  }
  std::ranges::sort(open_, [](const OpenFace& a, const OpenFace& b) {
    return a.edge != b.edge ? a.edge < b.edge : a.cell < b.cell;
  });
  for (size_t i = 0; i + 1 < open_.size(); i += 2) {
    cells_[open_[i].cell].neighbours[open_[i].face] = open_[i + 1].cell;
    cells_[open_[i + 1].cell].neighbours[open_[i + 1].face] = open_[i].cell;
  }
}

int Tetrahedra::add(const Eigen::Vector3d& point) {
  const GridPoint wanted = rounded(point);
  int cell = locate(wanted, hint(wanted));
  for (const int v : cells_[cell].vertices) {
    if (points_[v] == wanted) return v;
  }
  GridPoint placed = wanted;
  for (int attempt = 0; !find_cavity(placed, cell); ++attempt) {
    if (attempt == kMostNudges) return -1;
    placed = nudged(wanted, attempt);
    cell = locate(placed, cell);
  }
  const int vertex = static_cast<int>(points_.size());
  points_.push_back(placed);
  cell_of_.push_back(-1);
  fill_cavity(vertex);
  return vertex;
}

}  // namespace raysfm
