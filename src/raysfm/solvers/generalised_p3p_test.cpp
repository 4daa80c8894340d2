#include "raysfm/solvers/generalised_p3p.h"

#include <gtest/gtest.h>

#include <limits>

#include "raysfm/core/random.h"
#include "raysfm/solvers/p3p.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

using Eigen::Vector3d;

struct GeneralisedP3pProblem {
  std::array<Ray, 3> rays;
  std::array<Vector3d, 3> points;
  Rigid3 rig_from_world;
};

// Rays in all directions whose origins are about `spread` apart, points 1 to 8 units along them.
GeneralisedP3pProblem random_problem(Rng& rng, double spread, double scale = 1) {
  GeneralisedP3pProblem problem;
  problem.rig_from_world = {exp_so3(normal_vector(rng)), scale * normal_vector(rng)};
  const Rigid3 world_from_rig = problem.rig_from_world.inverse();
  for (int i = 0; i < 3; ++i) {
    Ray& ray = problem.rays[i];
    ray.origin = scale * spread * normal_vector(rng);
    ray.direction = normal_vector(rng).normalized();
    problem.points[i] = world_from_rig * (ray.origin + scale * rng.uniform(1, 8) * ray.direction);
  }
  return problem;
}

double pose_error(const Rigid3& a, const Rigid3& b, double scale) {
  return rotation_angle(a.rotation * b.rotation.conjugate()) +
         (a.translation - b.translation).norm() / (scale + b.translation.norm());
}

double best_error(const GeneralisedP3pProblem& problem, double scale = 1) {
  std::array<Rigid3, 8> poses;
  const int count = generalised_p3p(problem.rays, problem.points, &poses);
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < count; ++i) best = std::min(best, pose_error(poses[i], problem.rig_from_world, scale));
  return best;
}

class GeneralisedP3pSpread : public testing::TestWithParam<double> {};

TEST_P(GeneralisedP3pSpread, TruthIsAmongTheSolutions) {
  Rng rng(1);
  constexpr int kTrials = 10000;
  int missed = 0;
  for (int i = 0; i < kTrials; ++i) missed += best_error(random_problem(rng, GetParam())) > 1e-6;
  EXPECT_LE(missed, 5);
}

INSTANTIATE_TEST_SUITE_P(All, GeneralisedP3pSpread, testing::Values(0.0, 1e-3, 0.02, 0.3, 3.0));

TEST(GeneralisedP3p, EverySolutionPutsThePointsOnTheirRays) {
  Rng rng(2);
  std::array<Rigid3, 8> poses;
  double worst = 0;
  int most = 0;
  for (int i = 0; i < 10000; ++i) {
    const GeneralisedP3pProblem problem = random_problem(rng, 0.5);
    const int count = generalised_p3p(problem.rays, problem.points, &poses);
    most = std::max(most, count);
    for (int k = 0; k < count; ++k) {
      EXPECT_NEAR(poses[k].rotation.norm(), 1.0, 1e-12);
      for (int j = 0; j < 3; ++j) {
        const Vector3d seen = poses[k] * problem.points[j] - problem.rays[j].origin;
        worst = std::max(worst, (seen.normalized() - problem.rays[j].direction).norm());
      }
    }
  }
  EXPECT_LT(worst, 1e-6);
  EXPECT_GE(most, 4);
}

TEST(GeneralisedP3p, OneOriginIsP3p) {
  Rng rng(3);
  for (int i = 0; i < 200; ++i) {
    GeneralisedP3pProblem problem = random_problem(rng, 0);
    const Vector3d centre = normal_vector(rng);
    std::array<Vector3d, 3> bearings;
    for (int j = 0; j < 3; ++j) problem.rays[j].origin = centre, bearings[j] = problem.rays[j].direction;
    std::array<Rigid3, 8> poses;
    std::array<Rigid3, 4> central;
    ASSERT_EQ(generalised_p3p(problem.rays, problem.points, &poses), p3p(bearings, problem.points, &central));
    for (int k = 0; k < p3p(bearings, problem.points, &central); ++k) {
      EXPECT_LT((poses[k].translation - centre - central[k].translation).norm(), 1e-12);
    }
  }
}

TEST(GeneralisedP3p, ScaleAndTheFrameOfTheRigDoNotMatter) {
  Rng rng(4);
  int missed = 0;
  for (const double scale : {1e-4, 1e4}) {
    for (int i = 0; i < 1000; ++i) missed += best_error(random_problem(rng, 0.3, scale), scale) > 1e-6;
  }
  for (int i = 0; i < 1000; ++i) {
    GeneralisedP3pProblem problem = random_problem(rng, 0.3);
    const Rigid3 other_from_rig{exp_so3(normal_vector(rng)), 5 * normal_vector(rng)};
    problem.rig_from_world = other_from_rig * problem.rig_from_world;
    for (Ray& ray : problem.rays) {
      ray.origin = other_from_rig * ray.origin;
      ray.direction = other_from_rig.rotation * ray.direction;
    }
    missed += best_error(problem) > 1e-6;
  }
  EXPECT_LE(missed, 3);
}

TEST(GeneralisedP3p, TwoOfThreeFromOneCamera) {
  Rng rng(5);
  int missed = 0;
  for (int i = 0; i < 2000; ++i) {
    GeneralisedP3pProblem problem = random_problem(rng, 0.5);
    problem.rays[1].origin = problem.rays[0].origin;
    problem.points[1] = problem.rig_from_world.inverse() *
                        (problem.rays[1].origin + rng.uniform(1, 8) * problem.rays[1].direction);
    missed += best_error(problem) > 1e-6;
  }
  EXPECT_LE(missed, 2);
}

TEST(GeneralisedP3p, DegenerateInputGivesNothing) {
  Rng rng(6);
  std::array<Rigid3, 8> poses;
  GeneralisedP3pProblem problem = random_problem(rng, 0.5);
  problem.points[2] = problem.points[0] + 0.3 * (problem.points[1] - problem.points[0]);
  EXPECT_EQ(generalised_p3p(problem.rays, problem.points, &poses), 0);
  problem.points = {Vector3d::Ones(), Vector3d::Ones(), Vector3d::Ones()};
  EXPECT_EQ(generalised_p3p(problem.rays, problem.points, &poses), 0);
  problem = random_problem(rng, 0.5);
  problem.rays[1].direction.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(generalised_p3p(problem.rays, problem.points, &poses), 0);
}

}  // namespace
}  // namespace raysfm
