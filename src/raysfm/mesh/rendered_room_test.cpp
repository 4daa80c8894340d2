#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/eval/alignment.h"
#include "raysfm/mesh/mesh_surface.h"
#include "raysfm/odometry/tracker.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

double distance_to(const synth::Quad& quad, const Eigen::Vector3d& x) {
  const Eigen::Vector3d off = x - quad.corner;
  const double u = std::clamp(off.dot(quad.right), 0.0, quad.width);
  const double v = std::clamp(off.dot(quad.down), 0.0, quad.height);
  return (off - u * quad.right - v * quad.down).norm();
}

// To first order, which does for a median of what is near.
double distance_to(const synth::Ellipsoid& e, const Eigen::Vector3d& x) {
  const Eigen::Vector3d in_axes = e.axes.transpose() * (x - e.centre);
  const Eigen::Vector3d scaled = in_axes.cwiseQuotient(e.radii);
  const double size = scaled.norm();
  return std::abs(size - 1) * size / std::max(1e-12, scaled.cwiseQuotient(e.radii).norm());
}

double distance_to(const synth::World& world, const Eigen::Vector3d& x) {
  double least = std::numeric_limits<double>::infinity();
  for (const synth::Quad& quad : world.quads) least = std::min(least, distance_to(quad, x));
  for (const synth::Ellipsoid& e : world.ellipsoids) least = std::min(least, distance_to(e, x));
  return least;
}

// The map of a run as a scene.
MeshScene scene_of(const Reconstruction& r) {
  MeshScene scene;
  scene.cameras = r.rig.cameras;
  scene.skews = {0};
  scene.points = r.points;
  scene.error_px = r.rms_reprojection_px;
  for (const KeyFrame& keyframe : r.keyframes) {
    const int view = static_cast<int>(scene.views.size());
    scene.views.push_back({0, *r.frames[keyframe.frame].world_from_rig});
    for (int k = keyframe.first_observation; k < keyframe.last_observation; ++k)
      scene.sights.push_back({r.observations[k].point, view, r.observations[k].pixel});
  }
  return scene;
}

// Points spread over a mesh: as many on a face as its area tells.
std::vector<Eigen::Vector3d> spread_over(const SurfaceMesh& mesh, int count) {
  double area = 0, passed = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) area += face_area(mesh, static_cast<int>(f));
  Rng rng(1);
  std::vector<Eigen::Vector3d> points;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    passed += face_area(mesh, static_cast<int>(f));
    while (static_cast<double>(points.size()) < count * passed / area) {
      double a = rng.uniform(), b = rng.uniform();
      if (a + b > 1) a = 1 - a, b = 1 - b;
      const auto& [i, j, k] = mesh.faces[f];
      points.push_back(mesh.positions[i] + a * (mesh.positions[j] - mesh.positions[i]) +
                       b * (mesh.positions[k] - mesh.positions[i]));
    }
  }
  return points;
}

// A room of 6.8 x 5.6 m that somebody walks through, tracked from its images; truth is what was rendered.
TEST(RenderedRoom, SurfaceIsWhereTheRoomIs) {
  const testing_support::SynthViews views = testing_support::synth_views("room", "handheld", 150);
  auto tracker = Tracker::create(Rig{{testing_support::small_camera()}}, {});
  ASSERT_TRUE(tracker.ok());
  for (int i = 0; i < views.size(); ++i) ASSERT_TRUE((*tracker)->push(views.view(i, i)).ok());
  const Reconstruction r = (*tracker)->finish(true);
  Eigen::Matrix3Xd estimate(3, 0), truth(3, 0);
  for (size_t f = 0; f < r.frames.size(); ++f) {
    if (!r.frames[f].world_from_rig) continue;
    estimate.conservativeResize(3, estimate.cols() + 1);
    truth.conservativeResize(3, truth.cols() + 1);
    estimate.col(estimate.cols() - 1) = r.frames[f].world_from_rig->translation;
    truth.col(truth.cols() - 1) = views.world_from_rig[f].translation;
  }
  ASSERT_GT(estimate.cols(), 140);
  const Similarity3 true_from_map = align_points(estimate, truth, Alignment::kSim3);

  ThreadPool pool(0);
  const MeshScene scene = scene_of(r);
  const SceneSurface surface = scene_surface(surface_points(scene), MeshViews(scene), pool);
  ASSERT_GT(surface.mesh.faces.size(), 300u);
  const auto world = synth::make_world("room", {}, pool);
  ASSERT_TRUE(world.ok());
  std::vector<double> distances;
  for (const Eigen::Vector3d& x : spread_over(surface.mesh, 5000))
    distances.push_back(distance_to(*world, true_from_map * x));
  std::ranges::sort(distances);
  const double median = distances[distances.size() / 2], worst_tenth = distances[distances.size() * 9 / 10];
  RecordProperty("median_mm", static_cast<int>(1000 * median));
  RecordProperty("ninety_percent_mm", static_cast<int>(1000 * worst_tenth));
  EXPECT_LT(median, 0.01 * 6.8);
  EXPECT_LT(worst_tenth, 0.15 * 6.8);  // where the surface spans what was hidden
}

}  // namespace
}  // namespace raysfm
