#include "raysfm/solvers/p3p.h"

#include <gtest/gtest.h>

#include <limits>
#include <numbers>

#include "raysfm/core/random.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

using Eigen::Vector3d;

struct P3pProblem {
  std::array<Vector3d, 3> bearings, points;
  Rigid3 cam_from_world;
};

// Points in front of a camera with a wide view, anywhere in the world.
P3pProblem random_p3p(Rng& rng, double scale = 1.0, double flatness = 1.0) {
  P3pProblem problem;
  problem.cam_from_world = {exp_so3(std::numbers::pi * rng.uniform() * normal_vector(rng).normalized()),
                            scale * normal_vector(rng)};
  const Rigid3 world_from_cam = problem.cam_from_world.inverse();
  for (int i = 0; i < 3; ++i) {
    const Vector3d x(rng.uniform(-1, 1), rng.uniform(-1, 1), 1 + 1e-9 + flatness * rng.uniform(-0.5, 4));
    problem.bearings[i] = x.normalized();
    problem.points[i] = world_from_cam * (scale * x);
  }
  return problem;
}

double p3p_error(const Rigid3& a, const Rigid3& b, double scale = 1.0) {
  return rotation_angle(a.rotation * b.rotation.conjugate()) +
         (a.translation - b.translation).norm() / (scale + b.translation.norm());
}

double best_error(const P3pProblem& problem, double scale = 1.0) {
  std::array<Rigid3, 4> poses;
  const int count = p3p(problem.bearings, problem.points, &poses);
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < count; ++i) best = std::min(best, p3p_error(poses[i], problem.cam_from_world, scale));
  return best;
}

TEST(P3p, TruthIsAmongTheSolutions) {
  Rng rng(1);
  int missed = 0;
  for (int i = 0; i < 10000; ++i) missed += best_error(random_p3p(rng)) > 1e-6;
  EXPECT_LE(missed, 2);
}

TEST(P3p, EverySolutionPutsThePointsOnTheirBearings) {
  Rng rng(2);
  std::array<Rigid3, 4> poses;
  double worst = 0;
  for (int i = 0; i < 10000; ++i) {
    const P3pProblem problem = random_p3p(rng);
    const int count = p3p(problem.bearings, problem.points, &poses);
    for (int k = 0; k < count; ++k) {
      EXPECT_NEAR(poses[k].rotation.norm(), 1.0, 1e-12);
      for (int j = 0; j < 3; ++j) {
        const Vector3d seen = (poses[k] * problem.points[j]).normalized();
        worst = std::max(worst, (seen - problem.bearings[j]).norm());
      }
    }
  }
  EXPECT_LT(worst, 1e-6);
}

// Counted independently: the solutions of Grunert's system are the sign changes, along the one-parameter
// family of triangles that fit two of the sides, of the third law of cosines.
int count_by_scanning(const P3pProblem& problem) {
  const auto& b = problem.bearings;
  const auto& x = problem.points;
  const double side01 = (x[0] - x[1]).norm(), side02 = (x[0] - x[2]).norm(), side12 = (x[1] - x[2]).norm();
  const double c01 = b[0].dot(b[1]), c02 = b[0].dot(b[2]), c12 = b[1].dot(b[2]);
  const auto other = [](double d, double c, double side, int sign) {
    const double root = side * side - d * d * (1 - c * c);
    return root < 0 ? -1.0 : d * c + sign * std::sqrt(root);
  };
  int changes = 0;
  const double limit = std::min(side01 / std::sqrt(1 - c01 * c01), side02 / std::sqrt(1 - c02 * c02));
  for (const int sign1 : {-1, 1}) {
    for (const int sign2 : {-1, 1}) {
      double previous = 0;
      constexpr int kSteps = 20000;
      for (int i = 1; i < kSteps; ++i) {
        const double d0 = limit * std::sin(0.5 * std::numbers::pi * i / kSteps);
        const double d1 = other(d0, c01, side01, sign1), d2 = other(d0, c02, side02, sign2);
        const double value = d1 > 0 && d2 > 0 ? d1 * d1 + d2 * d2 - 2 * c12 * d1 * d2 - side12 * side12 : 0;
        changes += value * previous < 0;
        previous = value;
      }
    }
  }
  return changes;
}

TEST(P3p, FindsAsManySolutionsAsGrunertsSystemHas) {
  Rng rng(3);
  std::array<Rigid3, 4> poses;
  int same = 0;
  std::array<int, 5> histogram = {};
  constexpr int kProblems = 300;
  for (int i = 0; i < kProblems; ++i) {
    const P3pProblem problem = random_p3p(rng);
    const int count = p3p(problem.bearings, problem.points, &poses);
    ++histogram[count];
    same += count == count_by_scanning(problem);
  }
  EXPECT_GE(same, kProblems * 97 / 100);  // the scan misses pairs closer than its step
  EXPECT_GT(histogram[2], 0);
  EXPECT_GT(histogram[4], 0);
}

TEST(P3p, ScaleAndFrameDoNotMatter) {
  Rng rng(4);
  for (const double scale : {1e-6, 1e-3, 1e3, 1e6}) {
    int missed = 0;
    for (int i = 0; i < 1000; ++i) missed += best_error(random_p3p(rng, scale), scale) > 1e-6;
    EXPECT_LE(missed, 1) << scale;
  }
}

TEST(P3p, FrontoParallelPoints) {
  Rng rng(5);
  int missed = 0;
  for (int i = 0; i < 1000; ++i) missed += best_error(random_p3p(rng, 1.0, 0.0)) > 1e-6;
  EXPECT_LE(missed, 5);
}

TEST(P3p, SymmetricTriangle) {
  P3pProblem problem;
  problem.cam_from_world.translation = {0, 0, 3};
  for (int i = 0; i < 3; ++i) {
    const double angle = 2 * std::numbers::pi * i / 3;
    problem.points[i] = {std::cos(angle), std::sin(angle), 0};
    problem.bearings[i] = (problem.cam_from_world * problem.points[i]).normalized();
  }
  EXPECT_LT(best_error(problem), 1e-6);
}

TEST(P3p, DegenerateInputsHaveNoSolution) {
  Rng rng(6);
  std::array<Rigid3, 4> poses;
  P3pProblem collinear = random_p3p(rng);
  collinear.points[2] = 0.3 * collinear.points[0] + 0.7 * collinear.points[1];
  EXPECT_EQ(p3p(collinear.bearings, collinear.points, &poses), 0);
  P3pProblem same_point = random_p3p(rng);
  same_point.points[2] = same_point.points[1];
  EXPECT_EQ(p3p(same_point.bearings, same_point.points, &poses), 0);
  P3pProblem same_bearing = random_p3p(rng);
  same_bearing.bearings[2] = same_bearing.bearings[0];
  EXPECT_EQ(p3p(same_bearing.bearings, same_bearing.points, &poses), 0);
  P3pProblem not_a_number = random_p3p(rng);
  not_a_number.points[1].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(p3p(not_a_number.bearings, not_a_number.points, &poses), 0);
  not_a_number = random_p3p(rng);
  not_a_number.bearings[1].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(p3p(not_a_number.bearings, not_a_number.points, &poses), 0);
}

TEST(P3p, ArbitraryInputGivesFinitePoses) {
  Rng rng(7);
  std::array<Rigid3, 4> poses;
  for (int i = 0; i < 20000; ++i) {
    std::array<Vector3d, 3> bearings, points;
    for (int j = 0; j < 3; ++j) {
      bearings[j] = normal_vector(rng).normalized();
      points[j] = normal_vector(rng) * std::exp(3 * rng.normal());
      if (rng.uniform() < 0.1) points[j] = points[0] + 1e-8 * normal_vector(rng);
      if (rng.uniform() < 0.1) bearings[j] = (bearings[0] + 1e-7 * normal_vector(rng)).normalized();
    }
    const int count = p3p(bearings, points, &poses);
    ASSERT_LE(count, 4);
    for (int k = 0; k < count; ++k) {
      EXPECT_TRUE(poses[k].rotation.coeffs().allFinite() && poses[k].translation.allFinite());
    }
  }
}

}  // namespace
}  // namespace raysfm
