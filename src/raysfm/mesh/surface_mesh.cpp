#include "raysfm/mesh/surface_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <utility>

#include "raysfm/core/disjoint_sets.h"

namespace raysfm {
namespace {

void drop_faces(const std::vector<uint8_t>& keep, SurfaceMesh* mesh) {
  std::vector<int> number(mesh->faces.size(), -1);
  int count = 0;
  for (size_t f = 0; f < keep.size(); ++f) {
    if (keep[f]) number[f] = count++;
  }
  for (size_t f = 0; f < keep.size(); ++f) {
    if (number[f] < 0) continue;
    mesh->faces[number[f]] = mesh->faces[f];
    for (int e = 0; e < 3; ++e) {
      const int there = mesh->beyond[f][e];
      const int moved = there < 0 ? -1 : number[there / 3];
      mesh->beyond[number[f]][e] = moved < 0 ? -1 : 3 * moved + there % 3;
    }
  }
  mesh->faces.resize(count);
  mesh->beyond.resize(count);
}

// A vertex for every fan of faces.
void part_fans(SurfaceMesh* mesh) {
  DisjointSets corners(3 * mesh->faces.size());
  for (size_t f = 0; f < mesh->faces.size(); ++f) {
    for (int e = 0; e < 3; ++e) {
      const int there = mesh->beyond[f][e];
      if (there < 0) continue;
      // The edge runs the other way round on the other side.
      const int face = there / 3, edge = there % 3;
      corners.join(3 * static_cast<int>(f) + e, 3 * face + (edge + 1) % 3);
      corners.join(3 * static_cast<int>(f) + (e + 1) % 3, there);
    }
  }
  std::vector<int> vertex(3 * mesh->faces.size(), -1);
  SurfaceMesh parted;
  for (size_t c = 0; c < vertex.size(); ++c) {
    const int fan = corners.root(static_cast<int>(c));
    int& corner = mesh->faces[c / 3][c % 3];
    if (vertex[fan] < 0) {
      vertex[fan] = static_cast<int>(parted.positions.size());
      parted.positions.push_back(mesh->positions[corner]);
      parted.points.push_back(mesh->points[corner]);
    }
    corner = vertex[fan];
  }
  mesh->positions = std::move(parted.positions);
  mesh->points = std::move(parted.points);
}

// Two fans of faces that meet twice at both ends share an edge that has more than two faces: these. Empty
// almost always.
std::vector<uint8_t> free_of_crowded_edges(const SurfaceMesh& mesh, bool* crowded) {
  std::map<std::pair<int, int>, int> faces_of;
  const auto key = [&](size_t f, int e) {
    return std::minmax({mesh.faces[f][e], mesh.faces[f][(e + 1) % 3]});
  };
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int e = 0; e < 3; ++e) ++faces_of[key(f, e)];
  }
  std::vector<uint8_t> keep(mesh.faces.size(), 1);
  *crowded = false;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int e = 0; e < 3; ++e) {
      if (faces_of[key(f, e)] > 2) keep[f] = 0, *crowded = true;
    }
  }
  return keep;
}

}  // namespace

void keep_faces(const std::vector<uint8_t>& keep, SurfaceMesh* mesh) {
  drop_faces(keep, mesh);
  part_fans(mesh);
  bool crowded = false;
  for (std::vector<uint8_t> left = free_of_crowded_edges(*mesh, &crowded); crowded;
       left = free_of_crowded_edges(*mesh, &crowded)) {
    drop_faces(left, mesh);
    part_fans(mesh);
  }
}

std::vector<int> pieces_of(const SurfaceMesh& mesh) {
  DisjointSets sets(mesh.faces.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const int there : mesh.beyond[f]) {
      if (there >= 0) sets.join(static_cast<int>(f), there / 3);
    }
  }
  std::vector<int> pieces(mesh.faces.size());
  for (size_t f = 0; f < pieces.size(); ++f) pieces[f] = sets.root(static_cast<int>(f));
  return pieces;
}

namespace {

Eigen::Vector3d twice_area(const SurfaceMesh& mesh, int face) {
  const auto& [a, b, c] = mesh.faces[face];
  return (mesh.positions[b] - mesh.positions[a]).cross(mesh.positions[c] - mesh.positions[a]);
}

}  // namespace

double face_area(const SurfaceMesh& mesh, int face) {
  return twice_area(mesh, face).norm() / 2;
}

Eigen::Vector3d face_normal(const SurfaceMesh& mesh, int face) {
  const Eigen::Vector3d normal = twice_area(mesh, face);
  const double size = normal.norm();
  return size > 0 ? Eigen::Vector3d(normal / size) : Eigen::Vector3d::Zero();
}

double longest_edge(const SurfaceMesh& mesh, int face) {
  double longest = 0;
  for (int e = 0; e < 3; ++e) {
    longest = std::max(
        longest,
        (mesh.positions[mesh.faces[face][e]] - mesh.positions[mesh.faces[face][(e + 1) % 3]]).norm());
  }
  return longest;
}

void smooth(const std::vector<double>& reach, int rounds, SurfaceMesh* mesh) {
  const std::vector<Eigen::Vector3d> given = mesh->positions;
  std::vector<uint8_t> on_border(given.size(), 0);
  for (size_t f = 0; f < mesh->faces.size(); ++f) {
    for (int e = 0; e < 3; ++e) {
      if (mesh->beyond[f][e] < 0) on_border[mesh->faces[f][e]] = on_border[mesh->faces[f][(e + 1) % 3]] = 1;
    }
  }
  for (int round = 0; round < rounds; ++round) {
    std::vector<Eigen::Vector3d> sums(given.size(), Eigen::Vector3d::Zero());
    std::vector<int> counts(given.size(), 0);
    for (const auto& face : mesh->faces) {
      for (int k = 0; k < 3; ++k) {
        sums[face[k]] += mesh->positions[face[(k + 1) % 3]];
        ++counts[face[k]];
      }
    }
    for (size_t v = 0; v < given.size(); ++v) {
      if (on_border[v] || counts[v] == 0) continue;
      const Eigen::Vector3d wanted = (mesh->positions[v] + sums[v] / counts[v]) / 2;
      const Eigen::Vector3d off = wanted - given[v];
      mesh->positions[v] = given[v] + off * std::min(1.0, reach[v] / std::max(off.norm(), 1e-300));
    }
  }
}

}  // namespace raysfm
