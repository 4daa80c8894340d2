#include "raysfm/synth/scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "raysfm/core/random.h"
#include "support/test_worlds.h"

namespace raysfm::synth {
namespace {

using Eigen::Vector3d;

struct Hit {
  float distance;
  int surface;
};

Hit trace_one(const Scene& scene, const Vector3d& start, const Vector3d& direction) {
  float in[6][kRayPack], distance[kRayPack];
  int32_t surface[kRayPack];
  for (int i = 0; i < kRayPack; ++i) {
    for (int k = 0; k < 3; ++k) {
      in[k][i] = static_cast<float>(start[k]);
      in[k + 3][i] = static_cast<float>(direction[k]);
    }
  }
  scene.trace({kRayPack, in[0], in[1], in[2], in[3], in[4], in[5]}, distance, surface);
  for (int i = 1; i < kRayPack; ++i) EXPECT_EQ(surface[i], surface[0]);
  return {distance[0], surface[0]};
}

// The textbook intersections in double precision, one after the other.
std::optional<double> meet(const Quad& q, const Vector3d& s, const Vector3d& d) {
  const Vector3d normal = q.right.cross(q.down);
  const double t = normal.dot(q.corner - s) / normal.dot(d);
  const Vector3d x = s + t * d - q.corner;
  const double u = x.dot(q.right), v = x.dot(q.down);
  if (!(t > 1e-3) || u < 0 || u > q.width || v < 0 || v > q.height) return {};
  return t;
}

std::optional<double> meet(const Ellipsoid& e, const Vector3d& s, const Vector3d& d) {
  const Vector3d a = (e.axes.transpose() * (s - e.centre)).cwiseQuotient(e.radii);
  const Vector3d b = (e.axes.transpose() * d).cwiseQuotient(e.radii);
  const double half = a.dot(b), root = half * half - b.dot(b) * (a.dot(a) - 1);
  if (root < 0) return {};
  const double t = (-half - std::sqrt(root)) / b.dot(b);
  if (t <= 1e-3) return {};
  return t;
}

TEST(Scene, RectangleIsHitWhereAlgebraSays) {
  ThreadPool pool(0);
  World world = empty_world(pool);
  // In the plane z = 4: x in [-1, 2], y in [-0.5, 0.5]; far from the world's origin.
  const Vector3d away(1000, 50, -300);
  world.quads.push_back({away + Vector3d(-1, -0.5, 4), Vector3d::UnitX(), Vector3d::UnitY(), 3, 1, {}});
  const Scene scene(world, 0, away);
  for (const auto& [x, y, hit] : {std::tuple{0.0, 0.0, true},
                                  {1.99, 0.49, true},
                                  {-0.99, -0.49, true},
                                  {2.01, 0.0, false},
                                  {-1.01, 0.0, false},
                                  {0.0, 0.51, false},
                                  {0.0, -0.51, false}}) {
    const Vector3d to(x, y, 4);
    const Hit h = trace_one(scene, Vector3d::Zero(), to.normalized());
    EXPECT_EQ(h.surface, hit ? 0 : -1) << x << " " << y;
    if (hit) {
      EXPECT_NEAR(h.distance, to.norm(), 1e-5);
    }
    EXPECT_EQ(trace_one(scene, Vector3d::Zero(), -to.normalized()).surface, -1) << "behind the ray";
  }
  const Vector3d start(0.3, 0.1, -1);
  EXPECT_NEAR(trace_one(scene, start, Vector3d::UnitZ()).distance, 5, 1e-5) << "rays that begin elsewhere";
  EXPECT_EQ(trace_one(scene, Vector3d::Zero(), Vector3d::Zero()).surface, -1) << "a pixel that sees nothing";
}

TEST(Scene, EmptyWorldIsSeenAsNothing) {
  ThreadPool pool(0);
  const World world = empty_world(pool);
  EXPECT_EQ(trace_one(Scene(world, 0, Vector3d::Zero()), Vector3d::Zero(), Vector3d::UnitZ()).surface, -1);
}

TEST(Terrace, EverythingIsThereAgainTenMetresOn) {
  ThreadPool pool(1);
  const Result<World> world = make_world("terrace", {}, pool);
  ASSERT_TRUE(world);
  const auto there = [](const Vector3d& place) -> Vector3d { return place + Vector3d(0, 0, 10); };
  const auto alike = [](const Finish& a, const Finish& b) {
    return a.texture == b.texture && a.period == b.period && (a.tint == b.tint).all() &&
           a.shift_u == b.shift_u && a.shift_v == b.shift_v;
  };
  int looked_at = 0;
  for (const Quad& q : world->quads) {
    if (q.corner.z() < 0 || q.corner.z() > 10) continue;
    ++looked_at;
    EXPECT_TRUE(std::ranges::any_of(world->quads, [&](const Quad& o) {
      return (o.corner - there(q.corner)).norm() < 1e-9 && o.right == q.right && o.width == q.width &&
             o.height == q.height && alike(o.finish, q.finish);
    }));
  }
  EXPECT_GT(looked_at, 100);
  for (const Ellipsoid& e : world->ellipsoids) {
    if (e.centre.z() < 0 || e.centre.z() > 10) continue;
    EXPECT_TRUE(std::ranges::any_of(world->ellipsoids, [&](const Ellipsoid& o) {
      return (o.centre - there(e.centre)).norm() < 1e-9 && alike(o.finish, e.finish);
    }));
  }
  EXPECT_TRUE(world->walkers.empty());
}

class SceneOfWorld : public testing::TestWithParam<const char*> {};

TEST_P(SceneOfWorld, NearestSurfaceIsThatOfExhaustiveSearch) {
  ThreadPool pool(1);
  const Result<World> world = make_world(GetParam(), {}, pool);
  ASSERT_TRUE(world) << world.error().message;
  const double time = 3.7;
  const Vector3d origin = world->stage.eye + Vector3d(0.1, 0.05, 0.3);
  const Scene scene(*world, time, origin);
  std::vector<Ellipsoid> ellipsoids = world->ellipsoids;
  for (const Walker& w : world->walkers) w.pose(time, &ellipsoids);

  Rng rng(5);
  int hits = 0, disagreements = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vector3d direction = Vector3d(rng.normal(), 0.5 * rng.normal(), rng.normal()).normalized();
    double nearest = std::numeric_limits<double>::infinity();
    for (const Quad& q : world->quads)
      nearest = std::min(nearest, meet(q, origin, direction).value_or(nearest));
    for (const Ellipsoid& e : ellipsoids)
      nearest = std::min(nearest, meet(e, origin, direction).value_or(nearest));
    const Hit hit = trace_one(scene, Vector3d::Zero(), direction);
    const bool agree =
        std::isinf(nearest) ? hit.surface < 0 : std::abs(hit.distance - nearest) < 2e-5 * (1 + nearest);
    disagreements += !agree;
    hits += hit.surface >= 0;
  }
  EXPECT_GT(hits, 500);
  EXPECT_LE(disagreements, 2) << "more than rounding at the rims of surfaces explains";
}

INSTANTIATE_TEST_SUITE_P(Worlds, SceneOfWorld,
                         testing::Values("street", "terrace", "room", "corridor", "board"));

}  // namespace
}  // namespace raysfm::synth
