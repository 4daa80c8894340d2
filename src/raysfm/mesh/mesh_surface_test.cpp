#include "raysfm/mesh/mesh_surface.h"

#include <gtest/gtest.h>

#include <map>
#include <numbers>
#include <set>

#include "raysfm/mesh/face_views.h"
#include "raysfm/mesh/mesh_texture.h"
#include "support/box_room.h"
#include "support/model_fixtures.h"

namespace raysfm {
namespace {

using testing_support::box_room;
using testing_support::fixture_camera;
using testing_support::fixtures;
using testing_support::kRoomHalf;

// What a file's reader sees: vertices and faces alone.
struct Topology {
  int border_edges = 0, crowded_edges = 0, wrong_way = 0, euler = 0;
};

Topology topology_of(const SurfaceMesh& mesh) {
  std::map<std::pair<int, int>, int> directed;
  std::set<std::pair<int, int>> edges;
  std::set<int> vertices;
  Topology t;
  for (const auto& face : mesh.faces) {
    for (int e = 0; e < 3; ++e) {
      const int a = face[e], b = face[(e + 1) % 3];
      vertices.insert(a);
      edges.insert(std::minmax(a, b));
      t.wrong_way += ++directed[{a, b}] > 1;
    }
  }
  for (const auto& [a, b] : edges) {
    const int faces = directed[{a, b}] + directed[{b, a}];
    t.border_edges += faces == 1;
    t.crowded_edges += faces > 2;
  }
  t.euler = static_cast<int>(vertices.size() + mesh.faces.size()) - static_cast<int>(edges.size());
  return t;
}

// Of what the surface goes round, outside being where the cameras are.
double signed_volume(const SurfaceMesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.faces)
    sum += mesh.positions[a].dot(mesh.positions[b].cross(mesh.positions[c])) / 6;
  return sum;
}

Camera panorama() {
  Camera camera = fixture_camera(fixtures<Equirectangular>()[0]);
  camera.model = Equirectangular{512 / (2 * std::numbers::pi), 512 / (2 * std::numbers::pi), 255.5, 127.5};
  camera.width = 512;
  camera.height = 256;
  return camera;
}

// A thousand points on a sphere seen from all around.
MeshScene ball() {
  Rng rng(3);
  MeshScene scene;
  scene.cameras = {fixture_camera(fixtures<Pinhole>()[0])};
  scene.skews = {0};
  scene.error_px = 0.3;
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d x = Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal()).normalized();
    scene.points.push_back({x, {1, 2, 3}, 0});
  }
  for (int v = 0; v < 40; ++v) {
    // Evenly over the sphere, looking at the middle.
    const double height = 1 - 2 * (v + 0.5) / 40, angle = 2.39996 * v;
    const double across = std::sqrt(1 - height * height);
    const Eigen::Vector3d eye =
        4 * Eigen::Vector3d(across * std::cos(angle), height, across * std::sin(angle));
    const Rigid3 world_from_cam{Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), -eye), eye};
    scene.views.push_back({0, world_from_cam});
    for (int p = 0; p < 1000; ++p) {
      const Eigen::Vector3d& x = scene.points[p].position;
      Eigen::Vector2d pixel;
      if (x.dot(eye - x) < 0.3) continue;  // behind, or at the rim
      if (scene.cameras[0].project(world_from_cam.inverse() * x, &pixel))
        scene.sights.push_back({p, v, pixel});
    }
  }
  return scene;
}

SceneSurface surface_of(const MeshScene& scene, int workers = 0) {
  ThreadPool pool(workers);
  return scene_surface(surface_points(scene), MeshViews(scene), pool);
}

TEST(MeshSurface, ABallIsClosedAndAsLargeAsItIs) {
  const SurfaceMesh mesh = surface_of(ball()).mesh;
  const Topology t = topology_of(mesh);
  EXPECT_EQ(t.border_edges, 0);
  EXPECT_EQ(t.crowded_edges, 0);
  EXPECT_EQ(t.wrong_way, 0);
  EXPECT_EQ(t.euler, 2);
  // A polyhedron in a sphere is smaller.
  const double sphere = 4 * std::numbers::pi / 3;
  EXPECT_LT(signed_volume(mesh), sphere);
  EXPECT_GT(signed_volume(mesh), 0.97 * sphere);
  for (const Eigen::Vector3d& x : mesh.positions) EXPECT_NEAR(x.norm(), 1, 0.01);
}

// From within: the walls are what is full, so that the surface goes round nothing but emptiness.
TEST(MeshSurface, ARoomIsClosedFromWithin) {
  const SurfaceMesh mesh = surface_of(box_room(panorama(), 12, 1500, 0.1)).mesh;
  const Topology t = topology_of(mesh);
  EXPECT_EQ(t.border_edges, 0);
  EXPECT_EQ(t.euler, 2);
  const double room = 8 * kRoomHalf.prod();
  EXPECT_LT(signed_volume(mesh), 0);
  EXPECT_NEAR(-signed_volume(mesh) / room, 1, 0.04);
}

// Points in the middle of the room that a few rays tell of wrongly are not the surface's.
TEST(MeshSurface, WrongPointsInTheAirAreNotOnIt) {
  MeshScene scene = box_room(panorama(), 12, 1500, 0.1);
  const MeshViews views(scene);
  const int first = static_cast<int>(scene.points.size());
  Rng rng(9);
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector3d x(rng.uniform(-0.9, 0.9), rng.uniform(-0.5, 0.5), rng.uniform(-1.5, 1.5));
    scene.points.push_back({x, {0, 0, 0}, 0});
    for (int v = 0; v < 3; ++v) {
      Eigen::Vector2d pixel;
      if (views.pixel((i + v) % views.count(), x, &pixel))
        scene.sights.push_back({first + i, (i + v) % views.count(), pixel});
    }
  }
  int in_the_air = 0;
  for (const Eigen::Vector3d& x : surface_of(scene).mesh.positions)
    in_the_air += (x.cwiseAbs() - 0.9 * kRoomHalf).maxCoeff() < 0;
  EXPECT_LE(in_the_air, 2);
}

TEST(MeshSurface, DoesNotDependOnThreads) {
  const MeshScene scene = box_room(panorama(), 6, 400, 0.3);
  const SceneSurface one = surface_of(scene, 0), three = surface_of(scene, 3);
  EXPECT_EQ(one.mesh.faces, three.mesh.faces);
  EXPECT_EQ(one.mesh.positions, three.mesh.positions);
}

// A fan of faces at either end of an edge, and one corner that touches them.
TEST(SurfaceMesh, VerticesThatHoldTwoFansBecomeTwo) {
  SurfaceMesh mesh;
  for (int v = 0; v < 5; ++v) {
    mesh.positions.emplace_back(v, v * v, 0);
    mesh.points.push_back(v);
  }
  mesh.faces = {{0, 1, 2}, {0, 3, 4}};
  mesh.beyond = {{-1, -1, -1}, {-1, -1, -1}};
  keep_faces({1, 1}, &mesh);
  EXPECT_EQ(mesh.positions.size(), 6u);
  EXPECT_NE(mesh.faces[0][0], mesh.faces[1][0]);
  EXPECT_EQ(mesh.positions[mesh.faces[0][0]], mesh.positions[mesh.faces[1][0]]);
  keep_faces({0, 1}, &mesh);
  EXPECT_EQ(mesh.positions.size(), 3u);
  EXPECT_EQ(mesh.points[mesh.faces[0][1]], 3);
}

// Every model: what is painted on a wall is what the wall has there.
class MeshTextureOf : public testing::TestWithParam<Camera> {};

TEST_P(MeshTextureOf, ShowsTheColoursOfTheWalls) {
  const MeshScene scene = box_room(GetParam(), 10, 900, 0.05);
  const MeshViews views(scene);
  ThreadPool pool(1);
  const SceneSurface surface = surface_of(scene);
  ASSERT_GT(surface.mesh.faces.size(), 60u);
  const std::vector<int> chosen = choose_face_views(surface, views, pool);
  TexturePainter painter(surface.mesh, chosen, views, 1024);
  for (int v = 0; v < views.count(); ++v) {
    if (painter.wants(v)) painter.paint(v, testing_support::picture_of_room(scene, v), pool);
  }
  const MeshTexture texture = painter.take();
  double worst = 0, sum = 0;
  int count = 0;
  for (size_t f = 0; f < surface.mesh.faces.size(); ++f) {
    const auto& corners = surface.mesh.faces[f];
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    Eigen::Vector2d place = Eigen::Vector2d::Zero();
    for (int k = 0; k < 3; ++k) {
      middle += surface.mesh.positions[corners[k]] / 3;
      place += texture.places[f][k] / 3;
    }
    // Faces that lie in a wall, and not across an edge of the room.
    if (((middle.cwiseAbs() - kRoomHalf).cwiseAbs().minCoeff()) > 1e-3) continue;
    const std::array<double, 3> expected = testing_support::wall_color(middle);
    for (int c = 0; c < 3; ++c) {
      const double there = texture.rgb.row(
          static_cast<int>(std::lround(place.y())))[3 * static_cast<int>(std::lround(place.x())) + c];
      worst = std::max(worst, std::abs(there - expected[c]));
      sum += std::abs(there - expected[c]);
      ++count;
    }
  }
  ASSERT_GT(count, 100);
  EXPECT_LT(sum / count, 2);
  EXPECT_LT(worst, 12);  // half a texel of a view from far
}

INSTANTIATE_TEST_SUITE_P(Cameras, MeshTextureOf,
                         testing::Values(fixture_camera(fixtures<Pinhole>()[0]),
                                         fixture_camera(fixtures<KannalaBrandt>()[0]), panorama(),
                                         fixture_camera(fixtures<Mirror>()[0])));

}  // namespace
}  // namespace raysfm
