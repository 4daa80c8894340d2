#include "raysfm/mesh/visibility_surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "raysfm/mesh/cell_cut.h"
#include "raysfm/mesh/sight_walk.h"

namespace raysfm {
namespace {

constexpr int64_t kUnit = 1 << 16;      // cost of a ray that goes through what is full
constexpr double kFlatness = 1.0;       // rays that a face of flat tetrahedra costs
constexpr double kLeastApartPx = 3;     // of points that stay two
constexpr double kLeastApartSigma = 2;  // likewise
constexpr double kBehindSigma = 3;      // behind its point a ray ends in what is full
constexpr double kBoxMargin = 0.25;     // of the size of the scene

Eigen::AlignedBox3d box_about(std::span<const SurfacePoint> points) {
  Eigen::AlignedBox3d box;
  for (const SurfacePoint& point : points) {
    box.extend(point.position);
    for (const Eigen::Vector3d& eye : point.eyes) box.extend(eye);
  }
  const Eigen::Vector3d margin =
      Eigen::Vector3d::Constant(kBoxMargin * std::max(1e-9, box.sizes().maxCoeff()));
  return {box.min() - margin, box.max() + margin};
}

// The vertex that a point stands too close to, -1: none.
int vertex_at(const Tetrahedra& tetrahedra, const SurfacePoint& point) {
  const double apart = std::max(kLeastApartPx * point.pixel, kLeastApartSigma * point.sigma);
  int nearest = -1;
  double least = apart;
  for (const int v : tetrahedra.cells()[tetrahedra.locate(point.position)].vertices) {
    const double distance = (tetrahedra.position(v) - point.position).norm();
    if (v < Tetrahedra::kCorners || distance >= least) continue;
    least = distance;
    nearest = v;
  }
  return nearest;
}

void add_points(std::span<const SurfacePoint> points, SpaceDivision* space) {
  for (const SurfacePoint& point : points) {
    int vertex = vertex_at(space->tetrahedra, point);
    const bool is_new = vertex < 0;
    if (is_new) vertex = space->tetrahedra.add(point.position);
    if (vertex < Tetrahedra::kCorners) continue;
    const auto number = static_cast<size_t>(vertex - Tetrahedra::kCorners);
    if (number == space->points.size()) {
      space->points.push_back(point);
      space->points.back().position = space->tetrahedra.position(vertex);
      continue;
    }
    SurfacePoint& same = space->points[number];
    same.eyes.insert(same.eyes.end(), point.eyes.begin(), point.eyes.end());
    same.views.insert(same.views.end(), point.views.begin(), point.views.end());
  }
}

// Adds what rays say of tetrahedra to the costs of a cut.
class RayCosts {
 public:
  RayCosts(SpaceDivision* space, CellCut* cut) : space_(*space), cut_(*cut) {}

  void add(int vertex, const SurfacePoint& point, const Eigen::Vector3d& eye) {
    const Tetrahedra& tetrahedra = space_.tetrahedra;
    if (!tetrahedra.contains(eye)) return;
    const Eigen::Vector3d to_point = point.position - eye;
    const double distance = to_point.norm();
    if (!(distance > 0)) return;
    SightWalk walk(tetrahedra, tetrahedra.locate(eye), eye, point.position);
    cut_.add_if_inside(walk.cell(), kUnit);
    ++space_.rays[walk.cell()];
    while (!has_vertex(walk.cell(), vertex) && walk.next()) {
      const double before = (1 - walk.at()) * distance / std::max(point.sigma, 1e-300);
      const double weight = 1 - std::exp(-before * before / 2);
      cut_.add_face(walk.left_cell(), walk.left_face(), std::llround(weight * kUnit));
      ++space_.rays[walk.cell()];
    }
    const Eigen::Vector3d behind = point.position + (kBehindSigma * point.sigma / distance) * to_point;
    if (tetrahedra.contains(behind)) cut_.add_if_outside(tetrahedra.locate(behind), kUnit);
  }

 private:
  bool has_vertex(int cell, int vertex) const {
    return std::ranges::find(space_.tetrahedra.cells()[cell].vertices, vertex) !=
           space_.tetrahedra.cells()[cell].vertices.end();
  }

  SpaceDivision& space_;
  CellCut& cut_;
};

// Cosine of the angle between a face and the sphere about its tetrahedron: near 1 where the tetrahedron is
// flat there.
double sphere_cosine(const Eigen::Vector3d corners[4], const Eigen::Vector3d& normal) {
  const Eigen::Vector3d a = corners[1] - corners[0], b = corners[2] - corners[0], c = corners[3] - corners[0];
  const double volume = a.dot(b.cross(c));
  if (std::abs(volume) < 1e-300) return 1;
  const Eigen::Vector3d centre =
      (a.squaredNorm() * b.cross(c) + b.squaredNorm() * c.cross(a) + c.squaredNorm() * a.cross(b)) /
      (2 * volume);
  // Distance of the centre from the face, towards the tetrahedron, over the radius.
  return std::clamp(centre.dot(normal) / centre.norm(), -1.0, 1.0);
}

void add_flatness(const Tetrahedra& tetrahedra, CellCut* cut) {
  const std::vector<Tetrahedron>& cells = tetrahedra.cells();
  const auto cosine_of = [&](size_t cell, int face) {
    const auto& v = cells[cell].vertices;
    const int* f = kFaceVertices[face];
    const Eigen::Vector3d corners[4] = {tetrahedra.position(v[f[0]]), tetrahedra.position(v[f[1]]),
                                        tetrahedra.position(v[f[2]]), tetrahedra.position(v[face])};
    Eigen::Vector3d normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
    if (normal.dot(corners[3] - corners[0]) < 0) normal = -normal;
    return sphere_cosine(corners, normal);
  };
  for (size_t cell = 0; cell < cells.size(); ++cell) {
    for (int face = 0; face < 4; ++face) {
      const int beyond = cells[cell].neighbours[face];
      if (cells[cell].vertices[0] < 0 || beyond < static_cast<int>(cell)) continue;
      const auto& back = cells[beyond].neighbours;
      const int there = static_cast<int>(std::ranges::find(back, static_cast<int>(cell)) - back.begin());
      const double cosine = std::min(cosine_of(cell, face), cosine_of(static_cast<size_t>(beyond), there));
      const int64_t cost = std::llround(kFlatness * (1 - cosine) * kUnit / 2);
      cut->add_face(static_cast<int>(cell), face, cost);
      cut->add_face(beyond, there, cost);
    }
  }
}

// Faces between empty and full. What lies beyond the box counts as full.
class SurfaceMaker {
 public:
  explicit SurfaceMaker(SpaceDivision* space) : space_(*space), cells_(space->tetrahedra.cells()) {}

  void make() {
    face_of_.assign(4 * cells_.size(), -1);
    SurfaceMesh& mesh = space_.surface;
    for (int v = 0; v < space_.tetrahedra.vertex_count(); ++v) {
      mesh.positions.push_back(space_.tetrahedra.position(v));
      mesh.points.push_back(v - Tetrahedra::kCorners);
    }
    for (size_t arc = 0; arc < face_of_.size(); ++arc) {
      const int cell = static_cast<int>(arc) / 4, face = static_cast<int>(arc) % 4;
      const int beyond = cells_[cell].neighbours[face];
      if (!space_.is_outside[cell] || (beyond >= 0 && space_.is_outside[beyond])) continue;
      face_of_[arc] = static_cast<int>(mesh.faces.size());
      const auto& v = cells_[cell].vertices;
      const std::array<int, 3> f = seen_from_within(face);
      mesh.faces.push_back({v[f[0]], v[f[1]], v[f[2]]});
      space_.outer_cell.push_back(cell);
    }
    mesh.beyond.resize(mesh.faces.size());
    for (size_t arc = 0; arc < face_of_.size(); ++arc) {
      if (face_of_[arc] < 0) continue;
      for (int e = 0; e < 3; ++e) mesh.beyond[face_of_[arc]][e] = other_side(static_cast<int>(arc), e);
    }
  }

 private:
  // Vertices of a face, counter-clockwise as seen from the vertex opposite.
  static std::array<int, 3> seen_from_within(int face) {
    const int* f = kFaceVertices[face];
    return {f[0], f[2], f[1]};
  }

  // Turns about the edge through empty tetrahedra, up to the face that ends them.
  int other_side(int arc, int edge) const {
    int cell = arc / 4, through = arc % 4;
    const std::array<int, 3> f = seen_from_within(through);
    const int from = cells_[cell].vertices[f[edge]], to = cells_[cell].vertices[f[(edge + 1) % 3]];
    int exit = f[(edge + 2) % 3];  // the other face with this edge is opposite to the third vertex
    while (face_of_[4 * cell + exit] < 0) {
      const int hinge = cells_[cell].vertices[through];
      const int next = cells_[cell].neighbours[exit];
      const auto& v = cells_[next].vertices;
      const auto& back = cells_[next].neighbours;
      through = static_cast<int>(std::ranges::find(back, cell) - back.begin());
      exit = static_cast<int>(std::ranges::find(v, hinge) - v.begin());
      cell = next;
    }
    const int face = face_of_[4 * cell + exit];
    const std::array<int, 3>& corners = space_.surface.faces[face];
    for (int e = 0; e < 3; ++e) {
      if (corners[e] == to && corners[(e + 1) % 3] == from) return 3 * face + e;
    }
    return -1;
  }

  SpaceDivision& space_;
  const std::vector<Tetrahedron>& cells_;
  std::vector<int> face_of_;  // by cell and face; -1: not of the surface
};

}  // namespace

SpaceDivision divide_space(std::span<const SurfacePoint> points) {
  SpaceDivision space{Tetrahedra(box_about(points)), {}, {}, {}, {}, {}};
  add_points(points, &space);
  const std::vector<Tetrahedron>& cells = space.tetrahedra.cells();
  space.rays.assign(cells.size(), 0);
  CellCut cut(cells);
  RayCosts costs(&space, &cut);
  for (size_t p = 0; p < space.points.size(); ++p) {
    const SurfacePoint& point = space.points[p];
    for (const Eigen::Vector3d& eye : point.eyes) {
      costs.add(static_cast<int>(p) + Tetrahedra::kCorners, point, eye);
    }
  }
  add_flatness(space.tetrahedra, &cut);
  cut.solve();
  space.is_outside.resize(cells.size());
  for (size_t c = 0; c < cells.size(); ++c) {
    space.is_outside[c] = cells[c].vertices[0] >= 0 && cut.is_outside(static_cast<int>(c));
  }
  SurfaceMaker(&space).make();
  return space;
}

}  // namespace raysfm
