#include "raysfm/mesh/mesh_surface.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>

#include "raysfm/mesh/face_views.h"

namespace raysfm {
namespace {

constexpr double kLongest = 20;        // times the edges about a vertex
constexpr double kNarrow = 0.7;        // likewise, of the height of a face that does no harm
constexpr double kLeastPiece = 0.003;  // of all faces
constexpr int kSmoothRounds = 2;

void keep_real(SceneSurface* made) {
  SurfaceMesh& mesh = made->mesh;
  std::vector<uint8_t> keep(mesh.faces.size(), 1);
  for (size_t f = 0; f < keep.size(); ++f) {
    for (const int v : mesh.faces[f]) {
      if (mesh.points[v] < 0) keep[f] = 0;
    }
  }
  keep_faces(keep, &mesh);
}

// Length of the edges at each vertex that a quarter of them do not reach: those at the end of a wall that
// lead far away do not count.
std::vector<double> edges_about(const SurfaceMesh& mesh) {
  std::vector<std::vector<double>> lengths(mesh.positions.size());
  for (const auto& face : mesh.faces) {
    for (int e = 0; e < 3; ++e) {
      const double length = (mesh.positions[face[e]] - mesh.positions[face[(e + 1) % 3]]).norm();
      lengths[face[e]].push_back(length);
      lengths[face[(e + 1) % 3]].push_back(length);
    }
  }
  std::vector<double> usual(lengths.size(), 0.0);
  for (size_t v = 0; v < lengths.size(); ++v) {
    if (lengths[v].empty()) continue;
    const auto quarter = lengths[v].begin() + static_cast<ptrdiff_t>(lengths[v].size() / 4);
    std::nth_element(lengths[v].begin(), quarter, lengths[v].end());
    usual[v] = *quarter;
  }
  return usual;
}

void drop_long(SurfaceMesh* mesh) {
  const std::vector<double> about = edges_about(*mesh);
  std::vector<uint8_t> keep(mesh->faces.size(), 1);
  for (size_t f = 0; f < keep.size(); ++f) {
    std::array<double, 3> usual;
    for (int k = 0; k < 3; ++k) usual[k] = about[mesh->faces[f][k]];
    std::ranges::sort(usual);
    const int face = static_cast<int>(f);
    const double length = longest_edge(*mesh, face), across = 2 * face_area(*mesh, face) / length;
    keep[f] = length <= kLongest * usual[1] || across <= kNarrow * usual[0];
  }
  keep_faces(keep, mesh);
}

void drop_small(SurfaceMesh* mesh) {
  const std::vector<int> pieces = pieces_of(*mesh);
  std::map<int, int> faces;
  for (const int piece : pieces) ++faces[piece];
  std::vector<uint8_t> keep(pieces.size());
  for (size_t f = 0; f < keep.size(); ++f)
    keep[f] = faces[pieces[f]] >= kLeastPiece * static_cast<double>(pieces.size());
  keep_faces(keep, mesh);
}

}  // namespace

SceneSurface scene_surface(const std::vector<SurfacePoint>& points, const MeshViews& views,
                           ThreadPool& pool) {
  SceneSurface made{divide_space(points), {}};
  made.mesh = made.space.surface;
  keep_real(&made);
  drop_long(&made.mesh);
  std::vector<double> reach;
  for (const int point : made.mesh.points) reach.push_back(made.space.points[point].sigma);
  smooth(reach, kSmoothRounds, &made.mesh);
  drop_unseen(views, pool, &made);
  drop_small(&made.mesh);
  return made;
}

}  // namespace raysfm
