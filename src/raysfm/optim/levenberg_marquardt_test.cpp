#include "raysfm/optim/levenberg_marquardt.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <functional>
#include <vector>

namespace raysfm {
namespace {

// Two unknowns, dense. Keeps the cost after each accepted step.
struct Small {
  std::function<void(const Eigen::Vector2d&, Eigen::Vector2d*, Eigen::Matrix2d*)> f;
  Eigen::Vector2d x;
  Eigen::Vector2d trial{}, step{}, r{};
  Eigen::Matrix2d j{};
  double cost = 0, trial_cost = 0;
  std::vector<double> costs = {};

  double linearize() {
    f(x, &r, &j);
    return cost = 0.5 * r.squaredNorm();
  }
  LmStep solve(double lambda) {
    Eigen::Matrix2d h = j.transpose() * j;
    const Eigen::Vector2d d = h.diagonal();
    h.diagonal() += lambda * d;
    step = -h.ldlt().solve(j.transpose() * r);
    return {step.allFinite(), 0.5 * step.dot(lambda * d.cwiseProduct(step) - j.transpose() * r)};
  }
  LmTrial evaluate(bool linearize) {
    trial = x + step;
    Eigen::Vector2d trial_r;
    Eigen::Matrix2d trial_j;
    f(trial, &trial_r, &trial_j);
    if (linearize) r = trial_r, j = trial_j;
    return {cost, trial_cost = 0.5 * trial_r.squaredNorm(), linearize};
  }
  void accept() {
    x = trial;
    cost = trial_cost;
    costs.push_back(cost);
  }
};

void rosenbrock(const Eigen::Vector2d& x, Eigen::Vector2d* r, Eigen::Matrix2d* j) {
  *r << 10 * (x[1] - x[0] * x[0]), 1 - x[0];
  *j << -20 * x[0], 10, -1, 0;
}

TEST(LevenbergMarquardt, FindsTheBottomOfRosenbrock) {
  Small small{rosenbrock, {-1.2, 1.0}};
  const LmSummary summary =
      levenberg_marquardt(small, {.max_iterations = 100, .min_relative_decrease = 1e-12});
  EXPECT_LT((small.x - Eigen::Vector2d(1, 1)).norm(), 1e-9);
  EXPECT_NEAR(summary.initial_cost, 0.5 * (4.4 * 4.4 + 2.2 * 2.2), 1e-12);
  double last = summary.initial_cost;
  for (double cost : small.costs) {
    EXPECT_LE(cost, last);
    last = cost;
  }
  EXPECT_EQ(last, summary.final_cost);
}

// Says of its third step, and of those after it, that they settle it.
struct Settling : Small {
  int steps = 0;
  LmStep solve(double lambda) {
    LmStep step = Small::solve(lambda);
    step.settled = ++steps >= 3;
    return step;
  }
};

TEST(LevenbergMarquardt, TheStepThatSettlesIsTheLast) {
  Small all{rosenbrock, {-1.2, 1.0}};
  levenberg_marquardt(all, {.max_iterations = 100});
  Settling small{{rosenbrock, {-1.2, 1.0}}};
  const LmSummary summary = levenberg_marquardt(small, {.max_iterations = 100});
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_GE(summary.iterations, 3);
  EXPECT_LT(2 * small.costs.size(), all.costs.size());
  EXPECT_EQ(summary.final_cost, small.costs.back());  // and it is taken
  EXPECT_LT(small.costs.back(), summary.initial_cost);
}

TEST(LevenbergMarquardt, SaysWhyItStopped) {
  Small one{rosenbrock, {-1.2, 1.0}};
  EXPECT_EQ(levenberg_marquardt(one, {.max_iterations = 1}).termination, Termination::kMaxIterations);
  // Residuals that do not vanish at the bottom.
  Small flat{[](const Eigen::Vector2d& x, Eigen::Vector2d* r, Eigen::Matrix2d* j) {
               *r << x[0] + 0.1 * x[0] * x[0] - 1, x[0] + 2;
               *j << 1 + 0.2 * x[0], 0, 1, 1e-3;
             },
             {3, 0}};
  EXPECT_EQ(levenberg_marquardt(flat, {.max_iterations = 50}).termination, Termination::kConverged);
  Small broken{[](const Eigen::Vector2d&, Eigen::Vector2d* r, Eigen::Matrix2d* j) {
                 r->setConstant(NAN);
                 j->setConstant(NAN);
               },
               {1, 1}};
  EXPECT_EQ(levenberg_marquardt(broken, {}).termination, Termination::kNoProgress);
  // A gradient with the wrong sign: no step ever helps.
  Small wrong{[](const Eigen::Vector2d& x, Eigen::Vector2d* r, Eigen::Matrix2d* j) {
                *r << x[0] + 2, x[1] + 2;
                *j << -1, 0, 0, -1;
              },
              {1, 1}};
  const LmSummary summary = levenberg_marquardt(wrong, {.max_iterations = 100});
  EXPECT_EQ(summary.termination, Termination::kNoProgress);
  EXPECT_EQ(summary.final_cost, summary.initial_cost);
  EXPECT_EQ(wrong.x, Eigen::Vector2d(1, 1));
}

// Rosenbrock's valley makes steps be refused. A problem that keeps the normal equations of the current state
// then is not asked for them again, and comes to the same place by the same steps.
TEST(LevenbergMarquardt, NormalEquationsThatAreCurrentAreNotAskedForAgain) {
  struct Keeping : Small {
    int linearized = 0;
    double linearize() {
      ++linearized;
      return Small::linearize();
    }
    LmTrial evaluate(bool linearize) {
      const LmTrial trial_here = Small::evaluate(false);
      const bool there = linearize && trial_here.after <= trial_here.before;
      if (there) Small::evaluate(true);
      return {trial_here.before, trial_here.after, there};
    }
  };
  const LmOptions options{.max_iterations = 100, .min_relative_decrease = 1e-12};
  Small plain{rosenbrock, {-1.2, 1.0}};
  Keeping keeping{{rosenbrock, {-1.2, 1.0}}};
  const LmSummary expected = levenberg_marquardt(plain, options);
  const LmSummary summary = levenberg_marquardt(keeping, options);
  EXPECT_GT(summary.iterations, static_cast<int>(keeping.costs.size()));  // some were refused
  EXPECT_EQ(keeping.linearized, 1);
  EXPECT_EQ(summary.iterations, expected.iterations);
  EXPECT_EQ(keeping.x, plain.x);
}

TEST(LevenbergMarquardt, LastStepIsLeftOutWhereItIsNotWanted) {
  const LmOptions tried{.max_iterations = 100, .min_relative_decrease = 1e-3};
  LmOptions left_out = tried;
  left_out.try_last_step = false;
  // Linear: the second step has nothing left to win.
  const auto residual_at_the_bottom = [](const Eigen::Vector2d& x, Eigen::Vector2d* r, Eigen::Matrix2d* j) {
    *r << x[0] - 1, x[0] + 2;
    *j << 1, 0, 1, 0;
  };
  Small with{residual_at_the_bottom, {3, 0}}, without{residual_at_the_bottom, {3, 0}};
  EXPECT_EQ(levenberg_marquardt(with, tried).termination, Termination::kConverged);
  EXPECT_EQ(levenberg_marquardt(without, left_out).termination, Termination::kConverged);
  EXPECT_EQ(without.costs.size() + 1, with.costs.size());
  EXPECT_LT(without.cost, (1 + 1e-3) * with.cost);
}

}  // namespace
}  // namespace raysfm
