#include "raysfm/bundle/bal_problem.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/bundle_scene.h"
#include "support/ceres_bundle.h"

namespace raysfm {
namespace {

BalProblem disturbed_road(int cameras = 30) {
  BalProblem problem = test::make_bal_scene({.cameras = cameras, .points_per_camera = 25});
  test::perturb(&problem, 0.01, 0.05, 0.05, 3);
  return problem;
}

const BundleOptions kBalToTheEnd{.max_iterations = 100, .min_relative_decrease = 1e-12};

TEST(BalProblem, ReachesTheOptimumOfCeres) {
  for (const RobustLoss& loss : {RobustLoss{}, RobustLoss{RobustLoss::Kind::kHuber, 1}}) {
    BalProblem ours = disturbed_road(), theirs = ours;
    BundleOptions options = kBalToTheEnd;
    options.loss = loss;
    const BundleSummary summary = adjust_bal(&ours, options);
    const auto oracle =
        test::adjust_with_ceres(theirs, {.loss = loss, .max_iterations = 100, .function_tolerance = 1e-12});
    EXPECT_NEAR(summary.initial_cost, oracle.initial_cost, 1e-9 * oracle.initial_cost);
    EXPECT_NEAR(summary.final_cost, oracle.final_cost, 1e-7 * oracle.final_cost);
    EXPECT_EQ(summary.dropped_observations, 0);
    // Lenses do not depend on the gauge.
    for (size_t i = 0; i < ours.cameras.size(); ++i) {
      EXPECT_NEAR(ours.cameras[i][6], theirs.cameras[i][6], 0.02);
      EXPECT_NEAR(ours.cameras[i][7], theirs.cameras[i][7], 1e-3);
    }
  }
}

TEST(BalProblem, ExactPixelsGiveTheTrueLenses) {
  const BalProblem truth = test::make_bal_scene({.cameras = 12, .points_per_camera = 25, .noise_px = 0});
  BalProblem problem = truth;
  test::perturb(&problem, 0.002, 0.01, 0.01, 3);
  for (auto& camera : problem.cameras) camera[6] *= 1.02, camera[7] += 0.01;
  EXPECT_LT(adjust_bal(&problem, kBalToTheEnd).final_cost, 1e-12);
  for (size_t i = 0; i < truth.cameras.size(); ++i) {
    EXPECT_NEAR(problem.cameras[i][6], truth.cameras[i][6], 1e-4);
    EXPECT_NEAR(problem.cameras[i][7], truth.cameras[i][7], 1e-6);
    EXPECT_NEAR(problem.cameras[i][8], truth.cameras[i][8], 1e-6);
  }
}

TEST(BalProblem, ThreadsChangeNoBit) {
  std::vector<BalProblem> results;
  for (int threads : {1, 2, 3}) {
    results.push_back(disturbed_road(60));
    adjust_bal(&results.back(), {.max_iterations = 4, .threads = threads});
  }
  for (const BalProblem& result : results) {
    EXPECT_EQ(result.cameras, results[0].cameras);
    EXPECT_EQ(result.points, results[0].points);
  }
}

TEST(BalProblem, BehindTheCameraIsDroppedAndCounted) {
  BalProblem problem = disturbed_road();
  // On the far side of the first camera that sees it.
  const int p = problem.observations[0].point;
  const auto& c = problem.cameras[problem.observations[0].camera];
  const Rigid3 pose{exp_so3({c[0], c[1], c[2]}), {c[3], c[4], c[5]}};
  problem.points[p] = pose.inverse() * Eigen::Vector3d(0, 0, 300);
  int sightings = 0;
  for (const auto& o : problem.observations) sightings += o.point == p;
  const BundleSummary summary = adjust_bal(&problem, BundleOptions{});
  EXPECT_GT(summary.dropped_observations, 0);
  EXPECT_LE(summary.dropped_observations, sightings);
  EXPECT_EQ(summary.dropped_observations + summary.used_observations,
            static_cast<int>(problem.observations.size()));
}

TEST(BalProblem, StopsWhenToldAndKeepsWhatIsDone) {
  BalProblem problem = disturbed_road(), whole = problem;
  std::vector<IterationInfo> seen;
  BundleOptions options = kBalToTheEnd;
  options.progress = [&](const IterationInfo& info) {
    seen.push_back(info);
    return seen.size() < 3;
  };
  const BundleSummary summary = adjust_bal(&problem, options);
  EXPECT_EQ(summary.termination, Termination::kInterrupted);
  ASSERT_EQ(seen.size(), 3u);
  EXPECT_EQ(seen[2].iteration, 3);
  EXPECT_EQ(seen[2].cost, summary.final_cost);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
  EXPECT_GT(summary.final_cost, adjust_bal(&whole, kBalToTheEnd).final_cost);
  // What is kept is the state of that cost.
  const BundleSummary next = adjust_bal(&problem, BundleOptions{.max_iterations = 1});
  EXPECT_NEAR(next.initial_cost, summary.final_cost, 1e-9 * summary.final_cost);
}

TEST(BalProblem, ContradictionsAndExtremes) {
  const auto termination = [](auto spoil) {
    BalProblem problem = disturbed_road(12);
    spoil(problem);
    const BundleSummary summary = adjust_bal(&problem, BundleOptions{});
    EXPECT_TRUE(std::isfinite(summary.final_cost));
    return summary.termination;
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(termination([](BalProblem& p) { p.observations[5].camera = 12; }), Termination::kInvalidProblem);
  EXPECT_EQ(termination([](BalProblem& p) { p.observations[5].point = -1; }), Termination::kInvalidProblem);
  EXPECT_EQ(termination([](BalProblem& p) { p = {}; }), Termination::kNothingToDo);
  for (double value : {kNan, 1e300, -1e300, 0.0}) {
    for (int k = 0; k < 9; ++k) termination([&](BalProblem& p) { p.cameras[4][k] = value; });
    termination([&](BalProblem& p) { p.points[4].y() = value; });
    termination([&](BalProblem& p) { p.observations[4].pixel.y() = value; });
  }
}

}  // namespace
}  // namespace raysfm
