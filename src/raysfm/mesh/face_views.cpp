#include "raysfm/mesh/face_views.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>

#include "raysfm/mesh/sight_walk.h"

namespace raysfm {
namespace {

constexpr double kLeastCosine = 0.08;    // between the normal of a face and the ray to it
constexpr double kMostBend = 0.35;       // of an edge in the image, of its length
constexpr double kFreePx = 2;            // that edges may bend anyway
constexpr double kCloseToFace = 0.3;     // of its longest edge: what is full there hides nothing
constexpr double kNeighbourWorth = 0.3;  // of a neighbour with the same view, of the best view's size
constexpr int kSweeps = 8;

struct RatedView {
  int view;
  double size;  // square root of the pixels
};

// Looks at faces through views.
class FaceRater {
 public:
  FaceRater(const SceneSurface& surface, const MeshViews& views) : surface_(surface), views_(views) {}

  // The views that show a face: those that see its points, or else any.
  std::vector<RatedView> rate(int face) const {
    const std::vector<int> near = views_of_points(face), all = all_views();
    for (const bool whole : {true, false}) {
      for (const std::vector<int>* candidates : {&near, &all}) {
        std::vector<RatedView> rated = rate(face, *candidates, whole);
        if (!rated.empty()) return rated;
      }
    }
    return {};
  }

 private:
  std::vector<int> views_of_points(int face) const {
    std::vector<int> views;
    for (const int v : surface_.mesh.faces[face]) {
      const std::vector<int>& seen = surface_.space.points[surface_.mesh.points[v]].views;
      views.insert(views.end(), seen.begin(), seen.end());
    }
    std::ranges::sort(views);
    views.erase(std::unique(views.begin(), views.end()), views.end());
    return views;
  }

  std::vector<int> all_views() const {
    std::vector<int> views(views_.count());
    std::iota(views.begin(), views.end(), 0);
    return views;
  }

  std::vector<RatedView> rate(int face, const std::vector<int>& candidates, bool whole) const {
    std::vector<RatedView> rated;
    for (const int view : candidates) {
      const double size = size_in(face, view, whole);
      if (size > 0) rated.push_back({view, size});
    }
    return rated;
  }

  // The middle of a face, and places near its corners.
  std::array<Eigen::Vector3d, 4> places_of(int face) const {
    const auto& [a, b, c] = surface_.mesh.faces[face];
    const std::vector<Eigen::Vector3d>& x = surface_.mesh.positions;
    const Eigen::Vector3d middle = (x[a] + x[b] + x[c]) / 3;
    return {middle, (middle + 3 * x[a]) / 4, (middle + 3 * x[b]) / 4, (middle + 3 * x[c]) / 4};
  }

  // 0 where the view does not have all of the face in its image, or something is before its middle, or where
  // the `whole` face shall be seen before another place of it.
  double size_in(int face, int view, bool whole) const {
    Eigen::Vector3d x[3];
    Eigen::Vector2d pixel[3], middle;
    for (int k = 0; k < 3; ++k) {
      x[k] = surface_.mesh.positions[surface_.mesh.faces[face][k]];
      if (!views_.pixel(view, x[k], &pixel[k])) return 0;
    }
    for (int k = 0; k < 3; ++k) {
      const int next = (k + 1) % 3;
      if (!views_.pixel(view, (x[k] + x[next]) / 2, &middle)) return 0;
      const double bend = (middle - (pixel[k] + pixel[next]) / 2).norm();
      if (bend > kMostBend * (pixel[k] - pixel[next]).norm() + kFreePx) return 0;
    }
    const std::array<Eigen::Vector3d, 4> places = places_of(face);
    for (const Eigen::Vector3d& place : std::span(places).first(whole ? 4 : 1)) {
      if (!is_seen(face, view, place)) return 0;
    }
    const Eigen::Vector2d a = pixel[1] - pixel[0], b = pixel[2] - pixel[0];
    return std::sqrt(std::abs(a.x() * b.y() - a.y() * b.x()) / 2);
  }

  // From its front, and nothing full is between.
  bool is_seen(int face, int view, const Eigen::Vector3d& point) const {
    Eigen::Vector2d pixel;
    Eigen::Vector3d eye;
    if (!views_.pixel(view, point, &pixel) || !views_.eye(view, pixel, &eye)) return false;
    const Eigen::Vector3d to_eye = eye - point;
    const double distance = to_eye.norm();
    if (face_normal(surface_.mesh, face).dot(to_eye) < kLeastCosine * distance) return false;
    const Tetrahedra& tetrahedra = surface_.space.tetrahedra;
    if (!tetrahedra.contains(eye) || !tetrahedra.contains(point)) return false;
    const double close = kCloseToFace * longest_edge(surface_.mesh, face);
    SightWalk walk(tetrahedra, tetrahedra.locate(eye), eye, point);
    while (surface_.space.is_outside[walk.cell()]) {
      if (!walk.next()) return true;
    }
    return (1 - walk.at()) * distance <= close;
  }

  const SceneSurface& surface_;
  const MeshViews& views_;
};

int best_view(const std::vector<RatedView>& rated, const std::vector<int>& neighbours) {
  double largest = 0, most = -1;
  for (const RatedView& r : rated) largest = std::max(largest, r.size);
  int best = -1;
  for (const RatedView& r : rated) {
    const auto same = std::ranges::count(neighbours, r.view);
    const double worth = r.size / largest + kNeighbourWorth * static_cast<double>(same);
    if (worth > most) most = worth, best = r.view;
  }
  return best;
}

}  // namespace

std::vector<int> choose_face_views(const SceneSurface& surface, const MeshViews& views, ThreadPool& pool) {
  const SurfaceMesh& mesh = surface.mesh;
  const int faces = static_cast<int>(mesh.faces.size());
  std::vector<std::vector<RatedView>> rated(faces);
  std::vector<int> chosen(faces, -1);
  const FaceRater rater(surface, views);
  pool.parallel_for(faces, [&](int f) {
    rated[f] = rater.rate(f);
    chosen[f] = best_view(rated[f], {});
  });
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (int f = 0; f < faces; ++f) {
      std::vector<int> neighbours;
      for (const int there : mesh.beyond[f]) {
        if (there >= 0) neighbours.push_back(chosen[there / 3]);
      }
      chosen[f] = best_view(rated[f], neighbours);
    }
  }
  return chosen;
}

void drop_unseen(const MeshViews& views, ThreadPool& pool, SceneSurface* surface) {
  std::vector<uint8_t> keep(surface->mesh.faces.size(), 0);
  const FaceRater rater(*surface, views);
  pool.parallel_for(static_cast<int>(keep.size()), [&](int f) { keep[f] = !rater.rate(f).empty(); });
  keep_faces(keep, &surface->mesh);
}

}  // namespace raysfm
