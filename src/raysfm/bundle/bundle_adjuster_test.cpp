#include "raysfm/bundle/bundle_adjuster.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <new>

#include "raysfm/bundle/bundle_core.h"
#include "support/bundle_scene.h"
#include "support/ceres_bundle.h"

namespace {
std::atomic<long> allocations{0};
}  // namespace

[[gnu::noinline]] void* operator new(size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void* operator new(size_t size, std::align_val_t alignment) {
  ++allocations;
  const size_t a = static_cast<size_t>(alignment);
  if (void* memory = std::aligned_alloc(a, (size + a - 1) / a * a)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, size_t) noexcept {
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::align_val_t) noexcept {
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, size_t, std::align_val_t) noexcept {
  std::free(memory);
}

namespace raysfm {
namespace {

using test::BundleScene;
using test::make_bundle_scene;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

bool projects(const BundleScene& scene, const BundleObservation& o, Eigen::Vector2d* pixel) {
  const Camera& camera = scene.cameras[o.camera];
  const Eigen::Vector3d x_in_rig = scene.poses[o.pose] * scene.points[o.point];
  return camera.project(camera.rig_from_cam.inverse() * x_in_rig, pixel);
}

// Half the sum of rho over the inliers that project, from the definition.
double cost_of(const BundleScene& scene, const RobustLoss& loss = {}) {
  double cost = 0;
  for (size_t i = 0; i < scene.observations.size(); ++i) {
    const BundleObservation& o = scene.observations[i];
    Eigen::Vector2d pixel;
    if (!scene.is_inlier[i] || !projects(scene, o, &pixel)) continue;
    cost += 0.5 * loss.cost((pixel - o.pixel).squaredNorm());
  }
  return cost;
}

std::vector<Camera> distorted_rig() {
  Camera left, right;
  left.model = Radtan{500, 510, 320, 240, -0.2, 0.05, 1e-3, -5e-4, 0};
  right.model = Pinhole{450, 450, 300, 250};
  right.rig_from_cam = {exp_so3({0.05, 0.2, -0.1}), {0.5, 0.02, -0.1}};
  left.width = right.width = 640, left.height = right.height = 480;
  return {left, right};
}

// A step that was none leaves the state, and another damping is tried on the same equations.
TEST(BundleCore, SolvesTwiceAtOneState) {
  BundleScene scene = make_bundle_scene({.points = 80, .cameras = distorted_rig()});
  const BundleProblem problem = scene.problem();
  const auto step_after = [&](std::initializer_list<double> dampings) {
    BundleCore<6> core;
    EXPECT_TRUE(core.load(problem, {}));
    core.linearize();
    for (const double damping : dampings) EXPECT_TRUE(core.solve(damping).valid);
    return Eigen::Vector<double, 6>(core.system().pose_step(2));
  };
  const Eigen::Vector<double, 6> once = step_after({1e-2});
  EXPECT_EQ(step_after({1e-4, 1e-2}), once);
  EXPECT_GT((step_after({1e-4}) - once).norm(), 1e-3 * once.norm());
}

TEST(BundleAdjuster, ReachesTheOptimumOfCeres) {
  using Kind = RobustLoss::Kind;
  struct {
    test::BundleSceneOptions scene;
    RobustLoss loss;
  } cases[] = {{{}, {}},
               {{}, {Kind::kHuber, 1}},
               {{}, {Kind::kCauchy, 1}},
               {{.point_error = 0.005}, {Kind::kTukey, 6}},  // not convex: start in the same basin
               {{.poses = 8, .free_poses = 8, .points = 200}, {}},
               {{.poses = 30, .free_poses = 30, .points = 400}, {}}};
  for (const auto& c : cases) {
    SCOPED_TRACE(testing::Message() << c.scene.free_poses << " free, loss " << int(c.loss.kind));
    BundleScene ours = make_bundle_scene(c.scene), theirs = ours;
    BundleAdjuster adjuster;
    const BundleSummary summary = adjuster.adjust(
        ours.problem(), {.loss = c.loss, .max_iterations = 200, .min_relative_decrease = 1e-13});
    const auto oracle =
        test::adjust_with_ceres(theirs, {.loss = c.loss, .max_iterations = 200, .function_tolerance = 1e-13});
    EXPECT_NEAR(summary.initial_cost, oracle.initial_cost, 1e-9 * oracle.initial_cost);
    EXPECT_NEAR(summary.final_cost, oracle.final_cost, 1e-8 * oracle.final_cost);
    EXPECT_EQ(summary.termination, Termination::kConverged);
    EXPECT_EQ(summary.dropped_observations, 0);
    if (c.scene.free_poses > 3) continue;  // the gauge is free
    for (size_t i = 0; i < ours.poses.size(); ++i) {
      EXPECT_LT((ours.poses[i].translation - theirs.poses[i].translation).norm(), 1e-4);
      EXPECT_LT(ours.poses[i].rotation.angularDistance(theirs.poses[i].rotation), 1e-5);
    }
  }
}

TEST(BundleAdjuster, StopsWhereTheGradientVanishes) {
  BundleScene scene = make_bundle_scene({.points = 150, .cameras = distorted_rig()});
  BundleAdjuster adjuster;
  const RobustLoss loss{RobustLoss::Kind::kHuber, 1};
  const BundleSummary summary =
      adjuster.adjust(scene.problem(), {.loss = loss, .max_iterations = 100, .min_relative_decrease = 1e-14});
  EXPECT_NEAR(summary.final_cost, cost_of(scene, loss), 1e-9 * summary.final_cost);
  EXPECT_LT(summary.final_cost, 0.1 * summary.initial_cost);
  const auto slope = [&](auto move) {
    BundleScene plus = scene, minus = scene;
    move(plus, 1e-6), move(minus, -1e-6);
    return (cost_of(plus, loss) - cost_of(minus, loss)) / 2e-6;
  };
  for (int i = 7; i < 10; ++i) {
    for (int k = 0; k < 6; ++k) {
      const double gradient = slope([&](BundleScene& s, double h) {
        s.poses[i] = retract(s.poses[i], h * Eigen::Matrix<double, 6, 1>::Unit(k));
      });
      EXPECT_NEAR(gradient, 0, 0.05);  // it was 1e5 at the start
    }
  }
  for (int p = 0; p < 150; ++p) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(slope([&](BundleScene& s, double h) { s.points[p][k] += h; }), 0, 0.05);
    }
  }
}

TEST(BundleAdjuster, ExactPixelsGiveTheTruth) {
  BundleScene scene = make_bundle_scene({.noise_px = 0, .cameras = distorted_rig()});
  BundleAdjuster adjuster;
  const BundleSummary summary =
      adjuster.adjust(scene.problem(), {.max_iterations = 50, .min_relative_decrease = 1e-12});
  EXPECT_LT(summary.final_cost, 1e-12);
  for (size_t i = 0; i < scene.poses.size(); ++i) {
    EXPECT_LT((scene.poses[i].translation - scene.true_poses[i].translation).norm(), 1e-7);
  }
  for (size_t p = 0; p < scene.points.size(); ++p) {
    EXPECT_LT((scene.points[p] - scene.true_points[p]).norm(), 1e-5);
  }
}

TEST(BundleAdjuster, CostNeverRises) {
  for (uint64_t seed = 1; seed <= 16; ++seed) {
    // Far from the optimum, so that steps are refused. With its points fixed, a pose that turns away loses
    // them.
    const bool fixed = seed % 2 == 0;
    BundleScene scene = make_bundle_scene({.poses = 6,
                                           .free_poses = 6,
                                           .points = 60,
                                           .pose_error = fixed ? 4.0 : 0.3,
                                           .point_error = 1.5,
                                           .seed = seed});
    scene.point_is_fixed.assign(scene.points.size(), fixed);
    BundleAdjuster adjuster;
    double last = kInf;
    for (int i = 0; i < 30; ++i) {
      Eigen::Vector2d pixel;
      int behind = 0;
      for (const BundleObservation& o : scene.observations) behind += !projects(scene, o, &pixel);
      const BundleSummary summary = adjuster.adjust(scene.problem(), {.max_iterations = 1});
      EXPECT_LE(summary.final_cost, summary.initial_cost);
      // A step does not buy its decrease with the loss of many observations.
      EXPECT_LE(summary.dropped_observations - behind, static_cast<int>(scene.observations.size()) / 50);
      // What was dropped before may project again, so compare where nothing was.
      if (summary.dropped_observations == 0) {
        EXPECT_LE(summary.initial_cost, last * (1 + 1e-12));
      }
      last = summary.dropped_observations == 0 ? summary.final_cost : kInf;
    }
  }
}

TEST(BundleAdjuster, WhatIsFixedStays) {
  BundleScene scene = make_bundle_scene({});
  scene.point_is_fixed.assign(scene.points.size(), 0);
  for (size_t p = 0; p < scene.points.size(); p += 2) scene.point_is_fixed[p] = 1;
  const BundleScene start = scene;
  BundleAdjuster adjuster;
  EXPECT_LT(adjuster.adjust(scene.problem(), {}).final_cost, cost_of(start));
  for (size_t i = 0; i < 7; ++i) EXPECT_EQ(scene.poses[i].translation, start.poses[i].translation);
  for (size_t p = 0; p < scene.points.size(); p += 2) EXPECT_EQ(scene.points[p], start.points[p]);
  EXPECT_NE(scene.points[1], start.points[1]);
}

TEST(BundleAdjuster, ResectionAndIntersection) {
  BundleScene resection = make_bundle_scene({.noise_px = 0, .point_error = 0});
  resection.point_is_fixed.assign(resection.points.size(), 1);
  BundleAdjuster adjuster;
  EXPECT_LT(adjuster.adjust(resection.problem(), {.max_iterations = 30}).final_cost, 1e-12);
  BundleScene intersection = make_bundle_scene({.free_poses = 0, .noise_px = 0});
  EXPECT_LT(adjuster.adjust(intersection.problem(), {.max_iterations = 30}).final_cost, 1e-12);
  intersection.point_is_fixed.assign(intersection.points.size(), 1);
  EXPECT_EQ(adjuster.adjust(intersection.problem(), {}).termination, Termination::kNothingToDo);
}

TEST(BundleAdjuster, TwoStagesFindTheOutliersAndTakeBackInliers) {
  BundleScene scene = make_bundle_scene({.point_error = 0.02});
  Rng rng(5);
  std::vector<uint8_t> is_outlier(scene.observations.size(), 0);
  for (size_t i = 0; i < scene.observations.size(); ++i) {
    if (rng.uniform() < 0.05) {
      is_outlier[i] = 1;
      scene.observations[i].pixel += 30 * Eigen::Vector2d(1 + rng.uniform(), 1 + rng.uniform());
    } else if (rng.uniform() < 0.05) {
      scene.is_inlier[i] = 0;  // wrongly rejected before
    }
  }
  BundleAdjuster adjuster;
  const BundleOptions options{.loss = {RobustLoss::Kind::kCauchy, 1}};
  const BundleSummary summary = adjuster.adjust_two_stage(scene.problem(), options, 4.0);
  int wrong = 0;
  for (size_t i = 0; i < is_outlier.size(); ++i) wrong += scene.is_inlier[i] == is_outlier[i];
  EXPECT_LE(wrong, 5);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
  for (size_t i = 7; i < 10; ++i) {
    EXPECT_LT((scene.poses[i].translation - scene.true_poses[i].translation).norm(), 0.02);
  }
}

// Points with wrong observations next to right ones come to rest over many steps, poses do not: where each
// has its own steps, poses are soon where they would be in the end.
TEST(BundleAdjuster, PosesSettleBeforeTheLastPointsDo) {
  const test::BundleSceneOptions options{.poses = 30, .free_poses = 28, .points = 3000, .point_error = 0.01};
  const auto make_scene = [&] {
    BundleScene scene = make_bundle_scene(options);
    Rng rng(5);
    for (BundleObservation& o : scene.observations) {
      if (rng.uniform() < 0.1) o.pixel += test::random_vector(rng, 3 * options.noise_px).head<2>();
    }
    return scene;
  };
  BundleOptions in_the_end{.loss = {RobustLoss::Kind::kHuber, options.noise_px},
                           .max_iterations = 300,
                           .min_relative_decrease = 1e-12,
                           .initial_damping = 1e-10};
  BundleOptions in_time = in_the_end, settling = in_the_end;
  in_time.min_relative_decrease = settling.min_relative_decrease = 1e-6;
  settling.settled = 1;
  BundleAdjuster adjuster;
  BundleScene best = make_scene(), timely = make_scene(), settled = make_scene();
  const double least = adjuster.adjust(best.problem(), in_the_end).final_cost;
  const BundleSummary all = adjuster.adjust(timely.problem(), in_time);
  const BundleSummary summary = adjuster.adjust(settled.problem(), settling);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LT(2 * summary.iterations, all.iterations);
  EXPECT_LT(summary.final_cost, (1 + 1e-4) * least);  // 5e-4 where points have no steps of their own
  double left = 0, error = 0;
  for (int i = 0; i < options.poses; ++i) {
    left += (settled.poses[i].translation - best.poses[i].translation).squaredNorm();
    error += (best.poses[i].translation - best.true_poses[i].translation).squaredNorm();
  }
  EXPECT_LT(std::sqrt(left), 0.1 * std::sqrt(error));
}

// By a loss that leaves nothing out points have their own steps from the first one on, however far off poses
// are; by one that redescends they do not, as they would leave out what fits in the end.
TEST(BundleAdjuster, PointsSettleFromTheFirstStepByALossThatDoesNotRedescend) {
  for (const auto kind : {RobustLoss::Kind::kHuber, RobustLoss::Kind::kCauchy}) {
    BundleScene plain = make_bundle_scene({.free_poses = 9, .pose_error = 0.1, .point_error = 0.1});
    BundleScene settled = plain;
    BundleOptions options{.loss = {kind, 0.5}, .max_iterations = 1};
    BundleAdjuster adjuster;
    adjuster.adjust(plain.problem(), options);
    options.settled = 1;
    adjuster.adjust(settled.problem(), options);
    for (size_t i = 0; i < plain.poses.size(); ++i)
      EXPECT_EQ(settled.poses[i].translation, plain.poses[i].translation);
    EXPECT_EQ(settled.points == plain.points, options.loss.redescends());
    const double most = options.loss.redescends() ? 1.001 : 0.9;  // of the cost where they are left alone
    EXPECT_LT(cost_of(settled, options.loss), most * cost_of(plain, options.loss));
  }
}

// With one standard deviation for all, its unit does not matter: powers of two do not even change the bits.
TEST(BundleAdjuster, StandardDeviationsAreTheUnitOfResiduals) {
  for (const bool angular : {false, true}) {
    BundleScene plain = make_bundle_scene({}), ones = plain, fours = plain;
    for (BundleScene* scene : {&plain, &ones, &fours}) {
      if (angular) test::observe_rays(scene, AngularWeight::kPixel);
    }
    ones.sigmas.assign(ones.observations.size(), 1);
    fours.sigmas.assign(fours.observations.size(), 4);
    BundleOptions options{.loss = {RobustLoss::Kind::kHuber, 0.5}};
    BundleAdjuster adjuster;
    const double cost = adjuster.adjust_two_stage(plain.problem(), options, 1.0).final_cost;
    EXPECT_EQ(adjuster.adjust_two_stage(ones.problem(), options, 1.0).final_cost, cost);
    options.loss.scale /= 4;
    EXPECT_EQ(adjuster.adjust_two_stage(fours.problem(), options, 0.25).final_cost * 16, cost);
    for (const BundleScene* scene : {&ones, &fours}) {
      EXPECT_EQ(scene->is_inlier, plain.is_inlier);
      EXPECT_EQ(scene->points, plain.points);
      for (size_t i = 0; i < plain.poses.size(); ++i) {
        EXPECT_EQ(scene->poses[i].translation, plain.poses[i].translation);
        EXPECT_EQ(scene->poses[i].rotation.coeffs(), plain.poses[i].rotation.coeffs());
      }
    }
  }
}

TEST(BundleAdjuster, WhatIsKnownToBeUncertainWeighsLess) {
  double with = 0, without = 0;
  for (uint64_t seed = 0; seed < 5; ++seed) {
    BundleScene scene = make_bundle_scene({.noise_px = 0.1, .seed = seed});
    Rng rng(seed);
    for (BundleObservation& o : scene.observations) {
      scene.sigmas.push_back(rng.uniform() < 0.5 ? 0.1f : 3.0f);
      if (scene.sigmas.back() > 1) o.pixel += 3 * Eigen::Vector2d(rng.normal(), rng.normal());
    }
    BundleScene unweighted = scene;
    unweighted.sigmas.clear();
    BundleAdjuster adjuster;
    const BundleSummary summary = adjuster.adjust_two_stage(scene.problem(), {}, 4.5);
    adjuster.adjust(unweighted.problem(), {});
    // A residual of two numbers exceeds 4.5 standard deviations four times in 100000.
    EXPECT_GE(summary.used_observations, static_cast<int>(scene.observations.size()) - 3);
    with += (scene.poses[9].translation - scene.true_poses[9].translation).norm();
    without += (unweighted.poses[9].translation - scene.true_poses[9].translation).norm();
  }
  EXPECT_LT(with, 0.2 * without);
}

TEST(BundleAdjuster, RefusesStandardDeviationsThatAreNone) {
  for (const float sigma : {0.0f, -1.0f, NAN, INFINITY}) {
    BundleScene scene = make_bundle_scene({.points = 20});
    scene.sigmas.assign(scene.observations.size(), 1);
    scene.sigmas[3] = sigma;
    EXPECT_EQ(BundleAdjuster().adjust(scene.problem(), {}).termination, Termination::kInvalidProblem);
  }
  BundleScene scene = make_bundle_scene({.points = 20});
  scene.sigmas.assign(scene.observations.size() - 1, 1);
  EXPECT_EQ(BundleAdjuster().adjust(scene.problem(), {}).termination, Termination::kInvalidProblem);
}

TEST(BundleAdjuster, DropsAndCountsWhatDoesNotProject) {
  BundleScene scene = make_bundle_scene({});
  scene.points[3] = scene.true_poses[0].inverse() * Eigen::Vector3d(0, 0, -100);  // behind every camera
  int sightings = 0;
  for (const BundleObservation& o : scene.observations) sightings += o.point == 3;
  const double start = cost_of(scene);
  const Eigen::Vector3d point = scene.points[3];
  BundleAdjuster adjuster;
  const BundleSummary summary = adjuster.adjust(scene.problem(), {});
  EXPECT_EQ(summary.dropped_observations, sightings);
  EXPECT_EQ(summary.used_observations, static_cast<int>(scene.observations.size()) - sightings);
  EXPECT_NEAR(summary.initial_cost, start, 1e-9 * start);
  EXPECT_EQ(scene.points[3], point);

  for (Eigen::Vector3d& x : scene.points) x = point;
  const BundleSummary none = adjuster.adjust(scene.problem(), {});
  EXPECT_EQ(none.termination, Termination::kNothingToDo);
  EXPECT_EQ(none.used_observations, 0);
  EXPECT_EQ(none.dropped_observations, static_cast<int>(scene.observations.size()));
}

// A point that is ten times too far: its Newton steps overshoot to behind the cameras. It must come in on
// shorter ones, and the others must not wait for it.
TEST(BundleAdjuster, APointThatOvershootsTheCameraIsHeldInView) {
  BundleScene scene = make_bundle_scene({.noise_px = 0});
  const Rigid3 world_from_rig = scene.true_poses[8].inverse();
  const Eigen::Vector3d x(0.5, 0.5, 4);
  scene.true_points.push_back(world_from_rig * x);
  scene.points.push_back(world_from_rig * (10 * x));
  const int p = static_cast<int>(scene.points.size()) - 1;
  for (int i = 7; i < 10; ++i) {
    Eigen::Vector2d pixel;
    ASSERT_TRUE(scene.cameras[0].project(scene.true_poses[i] * scene.true_points[p], &pixel));
    scene.observations.push_back({i, p, 0, pixel});
  }
  scene.is_inlier.assign(scene.observations.size(), 1);
  BundleAdjuster adjuster;
  const BundleSummary summary =
      adjuster.adjust(scene.problem(), {.max_iterations = 8, .min_relative_decrease = 0});
  EXPECT_EQ(summary.dropped_observations, 0);
  EXPECT_LT(summary.final_cost, 1e-9);
  EXPECT_LT((scene.points[p] - scene.true_points[p]).norm(), 1e-5);
}

// Pixels so far outside that the linearised step turns the only free pose away from everything it sees: the
// others would cost no more, and the view that is gone nothing.
TEST(BundleAdjuster, AStepThatLosesAViewIsRefused) {
  BundleScene scene = make_bundle_scene({.free_poses = 1, .point_error = 0});
  scene.point_is_fixed.assign(scene.points.size(), 1);
  for (BundleObservation& o : scene.observations) {
    if (o.pose == 9) o.pixel.x() += 1600;
  }
  BundleAdjuster adjuster;
  const BundleSummary summary = adjuster.adjust(scene.problem(), {.max_iterations = 50});
  EXPECT_EQ(summary.dropped_observations, 0);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
}

TEST(BundleAdjuster, SmallAndEmptyProblems) {
  BundleAdjuster adjuster;
  EXPECT_EQ(adjuster.adjust({}, {}).termination, Termination::kNothingToDo);
  BundleScene scene = make_bundle_scene({});
  scene.is_inlier.assign(scene.is_inlier.size(), 0);
  EXPECT_EQ(adjuster.adjust(scene.problem(), {}).termination, Termination::kNothingToDo);
  // One pose without observations, one point seen once, one never.
  scene = make_bundle_scene({});
  const Rigid3 pose = scene.poses[9];
  std::erase_if(scene.observations, [seen = false](const BundleObservation& o) mutable {
    if (o.pose == 9 || o.point == 0) return true;
    return o.point == 1 && std::exchange(seen, true);
  });
  scene.is_inlier.assign(scene.observations.size(), 1);
  const BundleSummary summary = adjuster.adjust(scene.problem(), {});
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_EQ(scene.poses[9].translation, pose.translation);
  EXPECT_TRUE(scene.points[1].allFinite());
}

TEST(BundleAdjuster, OrderAndEarlierWindowsDoNotMatter) {
  BundleScene scene = make_bundle_scene({.cameras = distorted_rig()}), again = scene;
  BundleAdjuster fresh, used;
  BundleScene other = make_bundle_scene({.poses = 40, .free_poses = 40, .points = 900, .seed = 9});
  used.adjust(other.problem(), {});
  fresh.adjust(scene.problem(), {});
  used.adjust(again.problem(), {});
  for (size_t i = 0; i < scene.poses.size(); ++i) {
    EXPECT_EQ(scene.poses[i].translation, again.poses[i].translation);
    EXPECT_EQ(scene.poses[i].rotation.coeffs(), again.poses[i].rotation.coeffs());
  }
  EXPECT_EQ(scene.points, again.points);
}

TEST(BundleAdjuster, ContradictionsAreRefused) {
  BundleAdjuster adjuster;
  const auto refused = [&](auto spoil) {
    BundleScene scene = make_bundle_scene({.points = 20});
    BundleOptions options;
    spoil(scene, options);
    return adjuster.adjust(scene.problem(), options).termination == Termination::kInvalidProblem;
  };
  using S = BundleScene;
  using O = BundleOptions;
  EXPECT_FALSE(refused([](S&, O&) {}));
  EXPECT_TRUE(refused([](S& s, O&) { s.observations[3].pose = 10; }));
  EXPECT_TRUE(refused([](S& s, O&) { s.observations[3].pose = -1; }));
  EXPECT_TRUE(refused([](S& s, O&) { s.observations[3].point = 20; }));
  EXPECT_TRUE(refused([](S& s, O&) { s.observations[3].camera = 1; }));
  EXPECT_TRUE(refused([](S& s, O&) { s.cameras.clear(); }));
  EXPECT_TRUE(refused([](S& s, O&) { s.is_inlier.pop_back(); }));
  EXPECT_TRUE(refused([](S& s, O&) { s.pose_is_free.pop_back(); }));
  EXPECT_TRUE(refused([](S& s, O&) { s.point_is_fixed.assign(3, 0); }));
  EXPECT_TRUE(refused([](S&, O& o) { o.loss = {RobustLoss::Kind::kHuber, 0}; }));
  EXPECT_TRUE(refused([](S&, O& o) { o.max_iterations = 0; }));
  EXPECT_TRUE(refused([](S&, O& o) { o.initial_damping = kNan; }));
}

TEST(BundleAdjuster, HugeAndNanValuesDoNoHarm) {
  const double values[] = {kNan, kInf, -kInf, 1e308, -1e308, 1e160, 1e-308, 0};
  BundleAdjuster adjuster;
  for (double value : values) {
    SCOPED_TRACE(value);
    for (int where = 0; where < 5; ++where) {
      BundleScene scene = make_bundle_scene({.points = 60});
      switch (where) {
        case 0:
          scene.points[7].x() = value;
          break;
        case 1:
          scene.observations[7].pixel.y() = value;
          break;
        case 2:
          scene.poses[8].translation.z() = value;
          break;
        case 3:
          scene.poses[2].rotation.coeffs()[1] = value;
          break;
        default:
          scene.points.assign(scene.points.size(), Eigen::Vector3d::Constant(value));
      }
      const BundleSummary summary = adjuster.adjust_two_stage(scene.problem(), {}, 4.0);
      EXPECT_TRUE(std::isfinite(summary.final_cost));
      EXPECT_TRUE(scene.poses[9].translation.allFinite());
      if (where != 0 && where != 4) {
        EXPECT_TRUE(scene.points[7].allFinite());
      }
    }
  }
}

// Windows, and whole sequences with the sparse factor, under either error, on one thread or two.
TEST(BundleAdjuster, WhatHasBeenSeenBeforeAllocatesNothing) {
  for (const bool angular : {false, true}) {
    for (const int threads : {1, 2}) {
      for (const int poses : {10, 40}) {
        BundleScene start = make_bundle_scene({.poses = poses, .free_poses = poses == 10 ? 3 : 40});
        if (angular) test::observe_rays(&start, AngularWeight::kPixel);
        BundleScene first = start, second = start;
        BundleAdjuster adjuster;
        const BundleOptions options{.min_relative_decrease = 0, .threads = threads};
        adjuster.adjust_two_stage(first.problem(), options, 4.0);
        const long before = allocations;
        adjuster.adjust_two_stage(second.problem(), options, 4.0);
        EXPECT_EQ(allocations - before, 0) << poses << " poses, " << threads << " threads";
      }
    }
  }
}

}  // namespace
}  // namespace raysfm
