#include "raysfm/bundle/bundle_methods.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "raysfm/bundle/hierarchy.h"
#include "raysfm/bundle/problem_cost.h"
#include "raysfm/bundle/residual.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

using test::BundleScene;
using test::make_bundle_scene;

// A street whose start bends away from the truth as dead reckoning does.
BundleScene drifting_street(int poses) {
  BundleScene scene = make_bundle_scene(
      {.poses = poses, .free_poses = poses, .points = 20 * poses, .pose_error = 0, .point_error = 0.05});
  for (int i = 0; i < poses; ++i) scene.poses[i] = scene.true_poses[i];
  Rng rng(6);
  Rigid3 drift;  // of the world, growing along the street
  std::vector<Rigid3> drift_of_pose;
  for (int i = 0; i < poses; ++i) {
    Eigen::Matrix<double, 6, 1> step;
    step << test::random_vector(rng, 0.01), test::random_vector(rng, 0.001);
    drift = retract(drift, step);
    drift_of_pose.push_back(drift);
    scene.poses[i] = scene.true_poses[i] * drift.inverse();
  }
  std::vector<int> first(scene.points.size(), -1);
  for (const BundleObservation& o : scene.observations) {
    if (first[o.point] < 0) first[o.point] = o.pose;
  }
  for (size_t p = 0; p < scene.points.size(); ++p) {
    if (first[p] >= 0) scene.points[p] = drift_of_pose[first[p]] * scene.points[p];
  }
  return scene;
}

const BundleOptions kOptions{.max_iterations = 50, .min_relative_decrease = 1e-9};

TEST(BundleMethods, HierarchicalEndsAtTheGlobalOptimum) {
  BundleScene global = drifting_street(60), hierarchical = global;
  const BundleSummary by_global = adjust_globally(global.problem(), kOptions);
  const BundleSummary by_halves = adjust_hierarchically(hierarchical.problem(), kOptions, {.piece = 15});
  EXPECT_NEAR(by_halves.initial_cost, by_global.initial_cost, 1e-9 * by_global.initial_cost);
  EXPECT_NEAR(by_halves.final_cost, by_global.final_cost, 1e-5 * by_global.final_cost);
  EXPECT_NEAR(by_halves.final_cost, problem_cost(hierarchical.problem(), {}).cost,
              1e-9 * by_halves.final_cost);
  EXPECT_EQ(by_halves.termination, Termination::kConverged);
}

// Mountains: the noise alone says how far they are, another distance in each part of a map.
void add_far_points(int count, int first, int last, BundleScene* scene) {
  Rng rng(4);
  for (int p = 0; p < count; ++p) {
    const Eigen::Vector3d ahead(rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), 1);
    const Eigen::Vector3d point = scene->true_poses[last].inverse() * (1e4 * ahead);
    for (int i = first; i < last; ++i) {
      Eigen::Vector2d pixel;
      ASSERT_TRUE(scene->cameras[0].project(scene->true_poses[i] * point, &pixel));
      pixel += 0.5 * Eigen::Vector2d(rng.normal(), rng.normal());
      scene->observations.push_back({i, static_cast<int>(scene->points.size()), 0, pixel});
      scene->is_inlier.push_back(1);
    }
    scene->points.push_back(point);
  }
}

TEST(BundleMethods, PartsMeetWhereMostPointsSay) {
  for (const int far_points : {1, 2, 5}) {
    BundleScene scene = drifting_street(60);
    add_far_points(far_points, 25, 35, &scene);
    const double before = problem_cost(scene.problem(), {}).cost;
    merge_pieces(scene.problem(), kOptions, {.piece = 15});
    EXPECT_LT(problem_cost(scene.problem(), {}).cost, 0.05 * before) << far_points;
  }
}

TEST(BundleMethods, HierarchicalKeepsWhatIsFixed) {
  for (const int fixed : {0, 30, 59}) {
    BundleScene scene = make_bundle_scene({.poses = 60, .free_poses = 60, .points = 900});
    scene.pose_is_free[fixed] = 0;
    const Rigid3 pose = scene.poses[fixed];
    const BundleSummary summary = adjust_hierarchically(scene.problem(), kOptions, {.piece = 15});
    EXPECT_EQ(scene.poses[fixed].translation, pose.translation);
    EXPECT_LT(summary.final_cost, 1.1 * 0.25 * scene.observations.size());
  }
}

TEST(BundleMethods, HierarchicalWithARigKeepsItsScale) {
  Camera left = test::pinhole_camera(), right = left;
  right.rig_from_cam.translation.x() = 0.5;
  BundleScene scene = make_bundle_scene(
      {.poses = 40, .free_poses = 40, .points = 600, .noise_px = 0, .cameras = {left, right}});
  EXPECT_TRUE(scale_is_observed(scene.problem()));
  EXPECT_FALSE(scale_is_observed(make_bundle_scene({}).problem()));
  adjust_hierarchically(scene.problem(), kOptions, {.piece = 12});
  const double length = (scene.poses[39].inverse().translation - scene.poses[0].inverse().translation).norm();
  const double truth =
      (scene.true_poses[39].inverse().translation - scene.true_poses[0].inverse().translation).norm();
  EXPECT_NEAR(length, truth, 1e-4 * truth);
}

// Never everything at once, but near its optimum: the windows leave less than a tenth above the noise.
TEST(BundleMethods, LocalComesNearTheGlobalOptimum) {
  BundleScene global = drifting_street(60), local = global;
  const BundleSummary by_global = adjust_globally(global.problem(), kOptions);
  const BundleSummary by_windows = adjust_locally(local.problem(), kOptions);
  EXPECT_LT(by_windows.final_cost, 1.25 * by_global.final_cost);
  EXPECT_GT(by_windows.final_cost, by_global.final_cost);
  EXPECT_LT(by_windows.final_cost, 0.1 * by_windows.initial_cost);
}

TEST(BundleMethods, BalProblemsByEveryMethod) {
  BalProblem start = test::make_bal_scene({.cameras = 40, .points_per_camera = 25});
  test::perturb(&start, 0.005, 0.02, 0.02, 3);
  BalProblem global = start, hierarchical = start, local = start;
  const BundleMethodOptions options{.bundle = kOptions, .hierarchy = {.piece = 15}};
  const double optimum = adjust_bal(&global, BundleMethod::kGlobal, options).final_cost;
  const BundleSummary by_halves = adjust_bal(&hierarchical, BundleMethod::kHierarchical, options);
  EXPECT_NEAR(by_halves.final_cost, optimum, 1e-4 * optimum);
  const BundleSummary by_windows = adjust_bal(&local, BundleMethod::kLocal, options);
  EXPECT_LT(by_windows.final_cost, 0.5 * by_windows.initial_cost);
}

TEST(BundleMethods, InterruptedMethodsKeepAWholeProblem) {
  for (const BundleMethod method :
       {BundleMethod::kGlobal, BundleMethod::kHierarchical, BundleMethod::kLocal}) {
    BundleScene scene = drifting_street(60);
    int left = 5;
    BundleMethodOptions options{.bundle = kOptions, .hierarchy = {.piece = 15}};
    options.bundle.progress = [&](const IterationInfo&) { return --left > 0; };
    const BundleSummary summary = adjust(scene.problem(), method, options);
    EXPECT_EQ(summary.termination, Termination::kInterrupted);
    EXPECT_EQ(left, 0);
    EXPECT_LE(summary.final_cost, summary.initial_cost);
    EXPECT_NEAR(summary.final_cost, problem_cost(scene.problem(), {}).cost, 1e-9 * summary.final_cost);
  }
}

TEST(BundleMethods, ContradictionsAndNothing) {
  BundleScene scene = make_bundle_scene({.points = 20});
  EXPECT_EQ(adjust_hierarchically(scene.problem(), {}, {.piece = 3, .overlap = 2}).termination,
            Termination::kInvalidProblem);
  EXPECT_EQ(adjust_hierarchically(scene.problem(), {}, {.piece = 3, .overlap = 0}).termination,
            Termination::kInvalidProblem);
  EXPECT_EQ(adjust_locally(scene.problem(), {}, {.free_cameras = 3, .window = 3}).termination,
            Termination::kInvalidProblem);
  for (const BundleMethod method :
       {BundleMethod::kGlobal, BundleMethod::kHierarchical, BundleMethod::kLocal}) {
    EXPECT_EQ(adjust(BundleProblem{}, method, {}).termination, Termination::kNothingToDo);
  }
}

constexpr int kPerPose = 20;
const BundleOptions kThinnedSteps{
    .max_iterations = 20, .min_relative_decrease = 1e-9, .initial_damping = 1e-8};

TEST(ChoosePoints, ThoseSeenMostOftenUntilEveryPoseHasEnough) {
  const std::vector<std::vector<int>> poses_of_point = {{0, 1}, {0, 1, 2}, {0, 1}, {1, 2}, {2}, {0, 1}};
  std::vector<BundleObservation> observations;
  for (int p = 0; p < 6; ++p) {
    for (const int pose : poses_of_point[p]) observations.push_back({pose, p, 0, Eigen::Vector2d::Zero()});
  }
  std::vector<Rigid3> poses(3);
  std::vector<Eigen::Vector3d> points(6, Eigen::Vector3d::Zero());
  BundleProblem problem;
  problem.rig_from_world = poses;
  problem.points = points;
  problem.observations = observations;
  EXPECT_EQ(choose_points(problem, 1), (std::vector<uint8_t>{0, 1, 0, 0, 0, 0}));
  EXPECT_EQ(choose_points(problem, 2), (std::vector<uint8_t>{1, 1, 0, 1, 0, 0}));
  EXPECT_EQ(choose_points(problem, 9), (std::vector<uint8_t>{1, 1, 1, 1, 0, 1}));  // one view tells nothing
  // What is no inlier does not count.
  std::vector<uint8_t> is_inlier(observations.size(), 1);
  is_inlier[0] = 0;
  problem.is_inlier = is_inlier;
  EXPECT_EQ(choose_points(problem, 2), (std::vector<uint8_t>{0, 1, 1, 1, 0, 0}));
}

// Two held poses, the rest and all points off the truth, and a wrong observation of every tenth point.
test::BundleScene spoiled_scene() {
  test::BundleScene scene = test::make_bundle_scene(
      {.poses = 40, .free_poses = 38, .points = 2000, .track = 8, .noise_px = 0, .pose_error = 0.003});
  for (size_t i = 0; i < scene.observations.size(); ++i) {
    BundleObservation& o = scene.observations[i];
    const bool opens_point = i == 0 || scene.observations[i - 1].point != o.point;
    if (opens_point && o.point % 10 == 0) o.pixel.x() += 40;
  }
  return scene;
}

TEST(AdjustThinned, AllPosesAndAllPointsArriveAndWhatIsWrongIsMarked) {
  test::BundleScene scene = spoiled_scene();
  const std::vector<uint8_t> is_chosen = choose_points(scene.problem(), kPerPose);
  EXPECT_LT(std::ranges::count(is_chosen, 1), 400);
  BundleAdjuster adjuster;
  BundleOptions options = kThinnedSteps;
  options.loss = {RobustLoss::Kind::kHuber, 1.0};
  const BundleSummary summary = adjust_thinned(adjuster, scene.problem(), options, options, 2.0, kPerPose);
  EXPECT_LT(summary.used_observations, 5000);
  for (size_t i = 0; i < scene.poses.size(); ++i) {
    const Rigid3 error = scene.poses[i] * scene.true_poses[i].inverse();
    EXPECT_LT(error.translation.norm(), 1e-5) << i;
    EXPECT_LT(log_so3(error.rotation).norm(), 1e-6) << i;
  }
  int off = 0, wrongly_marked = 0;
  for (size_t p = 0; p < scene.points.size(); ++p) {
    off += (scene.points[p] - scene.true_points[p]).norm() > 0.02;
  }
  for (size_t i = 0; i < scene.observations.size(); ++i) {
    const BundleObservation& o = scene.observations[i];
    const bool opens_point = i == 0 || scene.observations[i - 1].point != o.point;
    wrongly_marked += (scene.is_inlier[i] == 0) != (opens_point && o.point % 10 == 0);
  }
  EXPECT_EQ(wrongly_marked, 0);
  EXPECT_LT(off, 40);
}

TEST(AdjustThinned, ContradictionsAreRefused) {
  test::BundleScene scene = spoiled_scene();
  scene.observations[3].point = 5000;
  BundleAdjuster adjuster;
  const Rigid3 before = scene.poses[5];
  EXPECT_EQ(
      adjust_thinned(adjuster, scene.problem(), kThinnedSteps, kThinnedSteps, 2.0, kPerPose).termination,
      Termination::kInvalidProblem);
  EXPECT_EQ(scene.poses[5].translation, before.translation);
}

// At the truth but for what moves, with every seventh match wrong by less than an inlier may be.
BundleScene with_wrong_matches(double noise, double pose_error) {
  BundleScene scene = make_bundle_scene(
      {.noise_px = noise, .pose_error = pose_error, .point_error = 5 * pose_error, .seed = 3});
  for (size_t i = 0; i < scene.observations.size(); i += 7) scene.observations[i].pixel.x() += 1.5;
  return scene;
}

// The farthest that a pose is from its place.
double worst_place(const BundleScene& scene) {
  double worst = 0;
  for (size_t i = 0; i < scene.poses.size(); ++i) {
    worst = std::max(
        worst, (scene.poses[i].inverse().translation - scene.true_poses[i].inverse().translation).norm());
  }
  return worst;
}

TEST(LossForNoise, IsThreeStandardDeviationsWideWithinBounds) {
  for (const double noise : {0.06, 0.1, 0.2}) {
    BundleScene scene = with_wrong_matches(noise, 0);
    // Of the right ones the median is the 7/12 quantile: sqrt(log(12 / 5) / log(2)) of the noise.
    EXPECT_NEAR(noise_of(scene.problem()), 1.124 * noise, 0.08 * noise);
    EXPECT_EQ(loss_for_noise(scene.problem()).kind, RobustLoss::Kind::kHuber);
    EXPECT_DOUBLE_EQ(loss_for_noise(scene.problem()).scale, 3 * noise_of(scene.problem()));
    EXPECT_TRUE(redescending_loss_for_noise(scene.problem()).redescends());
    EXPECT_DOUBLE_EQ(redescending_loss_for_noise(scene.problem()).scale, 4.685 * noise_of(scene.problem()));
    for (size_t i = 0; i < scene.is_inlier.size(); i += 7) scene.is_inlier[i] = 0;
    EXPECT_NEAR(noise_of(scene.problem()), noise, 0.05 * noise);
  }
  BundleScene sharp = with_wrong_matches(0.001, 0), blurred = with_wrong_matches(0.6, 0);
  EXPECT_DOUBLE_EQ(loss_for_noise(sharp.problem()).scale, 0.1);
  EXPECT_DOUBLE_EQ(loss_for_noise(blurred.problem()).scale, 1);
  std::ranges::fill(sharp.is_inlier, uint8_t{0});
  EXPECT_EQ(noise_of(sharp.problem()), 0);
}

TEST(LossForNoise, MatchesThatAreWrongByLittlePullLess) {
  const auto error = [](bool by_noise) {
    BundleScene scene = with_wrong_matches(0.05, 1e-4);
    BundleOptions options{.loss = {RobustLoss::Kind::kHuber, 1.0}, .max_iterations = 50};
    if (by_noise) options.loss = loss_for_noise(scene.problem());
    BundleAdjuster().adjust(scene.problem(), options);
    return worst_place(scene);
  };
  EXPECT_LT(error(true), 0.5 * error(false));
}

}  // namespace
}  // namespace raysfm
