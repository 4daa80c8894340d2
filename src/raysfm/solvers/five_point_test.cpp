#include "raysfm/solvers/five_point.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <limits>
#include <numbers>
#include <vector>

#include "raysfm/core/random.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

using Eigen::Matrix3d;
using Eigen::Vector3d;

enum class Scene { kGeneral, kPlanar, kForward, kPlanarForward, kOmnidirectional };

struct FivePointProblem {
  std::array<Vector3d, 5> bearings0, bearings1;
  Rigid3 cam1_from_cam0;  // |translation| = 1

  Matrix3d essential() const {
    return skew(cam1_from_cam0.translation) * cam1_from_cam0.rotation.toRotationMatrix();
  }
};

FivePointProblem random_five_points(Rng& rng, Scene scene = Scene::kGeneral) {
  FivePointProblem problem;
  const bool forward = scene == Scene::kForward || scene == Scene::kPlanarForward;
  const bool planar = scene == Scene::kPlanar || scene == Scene::kPlanarForward;
  const Vector3d t = forward ? Vector3d(0.05 * rng.normal(), 0.05 * rng.normal(), -1) : normal_vector(rng);
  problem.cam1_from_cam0 = {exp_so3(0.2 * normal_vector(rng)), t.normalized()};
  const Vector3d plane = Vector3d(0.3 * rng.normal(), 0.3 * rng.normal(), 1).normalized();
  for (int i = 0; i < 5; ++i) {
    Vector3d x(rng.uniform(-1, 1), rng.uniform(-1, 1), 1);
    if (scene == Scene::kOmnidirectional) x = normal_vector(rng).normalized();
    x *= planar ? 4 / plane.dot(x) : rng.uniform(3, 10);
    problem.bearings0[i] = x.normalized();
    problem.bearings1[i] = (problem.cam1_from_cam0 * x).normalized();
  }
  return problem;
}

double essential_error(const Matrix3d& a, const Matrix3d& b) {
  return std::min((a - b).norm(), (a + b).norm()) / b.norm();
}

double best_error(const FivePointProblem& problem) {
  std::array<Matrix3d, 10> essentials;
  const int count = five_point(problem.bearings0, problem.bearings1, &essentials);
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < count; ++i) best = std::min(best, essential_error(essentials[i], problem.essential()));
  return best;
}

class FivePointScenes : public testing::TestWithParam<Scene> {};

TEST_P(FivePointScenes, TruthIsAmongTheSolutions) {
  Rng rng(1);
  int missed = 0;
  for (int i = 0; i < 10000; ++i) missed += !(best_error(random_five_points(rng, GetParam())) < 1e-6);
  EXPECT_LE(missed, 3);
}

INSTANTIATE_TEST_SUITE_P(All, FivePointScenes,
                         testing::Values(Scene::kGeneral, Scene::kPlanar, Scene::kForward,
                                         Scene::kPlanarForward, Scene::kOmnidirectional));

TEST(FivePoint, EverySolutionIsAnEssentialMatrixOfTheMatches) {
  Rng rng(2);
  std::array<Matrix3d, 10> essentials;
  int bad = 0, total = 0;
  for (int i = 0; i < 2000; ++i) {
    const FivePointProblem problem = random_five_points(rng);
    const int count = five_point(problem.bearings0, problem.bearings1, &essentials);
    for (int k = 0; k < count; ++k) {
      const Vector3d values = essentials[k].jacobiSvd().singularValues();
      bool good = (values - Vector3d(1, 1, 0)).norm() < 1e-7;
      for (int j = 0; j < 5; ++j) {
        good &= std::abs(problem.bearings1[j].dot(essentials[k] * problem.bearings0[j])) < 1e-9;
      }
      bad += !good;
      ++total;
    }
  }
  EXPECT_GT(total, 4000);
  EXPECT_LE(bad, total / 1000);
}

TEST(FivePoint, TheFrameDoesNotMatter) {
  Rng rng(3);
  std::array<Matrix3d, 10> first, second;
  int different = 0;
  constexpr int kProblems = 1000;
  for (int i = 0; i < kProblems; ++i) {
    const FivePointProblem problem = random_five_points(rng);
    FivePointProblem turned = problem;
    const Matrix3d turn0 = exp_so3(normal_vector(rng)).toRotationMatrix();
    const Matrix3d turn1 = exp_so3(normal_vector(rng)).toRotationMatrix();
    for (int j = 0; j < 5; ++j) {
      turned.bearings0[j] = turn0 * problem.bearings0[j];
      turned.bearings1[j] = turn1 * problem.bearings1[j];
    }
    const int count = five_point(problem.bearings0, problem.bearings1, &first);
    bool same = count == five_point(turned.bearings0, turned.bearings1, &second);
    for (int k = 0; same && k < count; ++k) {
      double nearest = 1;
      for (int l = 0; l < count; ++l) {
        nearest = std::min(nearest, essential_error(turn1.transpose() * second[l] * turn0, first[k]));
      }
      same = nearest < 1e-5;
    }
    different += !same;
  }
  EXPECT_LE(different, kProblems / 100);  // a pair of roots that almost coincides
}

TEST(FivePoint, DegenerateInputsGiveFiniteOutput) {
  Rng rng(4);
  std::array<Matrix3d, 10> essentials;
  const auto check = [&](const FivePointProblem& problem) {
    const int count = five_point(problem.bearings0, problem.bearings1, &essentials);
    EXPECT_LE(count, 10);
    for (int k = 0; k < count; ++k) {
      EXPECT_TRUE(essentials[k].allFinite());
      EXPECT_NEAR(essentials[k].norm(), std::sqrt(2.0), 1e-9);
    }
    return count;
  };
  for (int i = 0; i < 300; ++i) {
    FivePointProblem still = random_five_points(rng);  // no motion at all
    still.bearings1 = still.bearings0;
    check(still);
    FivePointProblem rotation = random_five_points(rng);
    for (int j = 0; j < 5; ++j)
      rotation.bearings1[j] = rotation.cam1_from_cam0.rotation * rotation.bearings0[j];
    check(rotation);
    FivePointProblem near_repeat = random_five_points(rng);
    near_repeat.bearings0[1] = (near_repeat.bearings0[0] + 1e-9 * normal_vector(rng)).normalized();
    near_repeat.bearings1[1] = near_repeat.bearings1[0];
    check(near_repeat);
    FivePointProblem repeat = random_five_points(rng);
    repeat.bearings0[3] = repeat.bearings0[2], repeat.bearings1[3] = repeat.bearings1[2];
    EXPECT_EQ(check(repeat), 0);
    FivePointProblem nothing = random_five_points(rng);
    nothing.bearings0[4].y() = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(check(nothing), 0);
    FivePointProblem random = random_five_points(rng);
    for (int j = 0; j < 5; ++j) random.bearings1[j] = normal_vector(rng).normalized();
    check(random);
  }
}

TEST(Essential, DecompositionHoldsTheTruthAndFourRotations) {
  Rng rng(5);
  for (int i = 0; i < 1000; ++i) {
    const FivePointProblem problem = random_five_points(rng, Scene::kOmnidirectional);
    const double scale = (rng.uniform() < 0.5 ? -1 : 1) * std::exp(rng.normal());
    const std::array<Rigid3, 4> poses = decompose_essential(scale * problem.essential());
    double best = 10;
    for (const Rigid3& pose : poses) {
      EXPECT_NEAR(pose.translation.norm(), 1, 1e-12);
      const Matrix3d e = skew(pose.translation) * pose.rotation.toRotationMatrix();
      EXPECT_LT(essential_error(e, problem.essential()), 1e-9);
      best = std::min(best, rotation_angle(pose.rotation * problem.cam1_from_cam0.rotation.conjugate()) +
                                (pose.translation - problem.cam1_from_cam0.translation).norm());
    }
    EXPECT_LT(best, 1e-9);
  }
}

TEST(Essential, CheiralityChoosesTheTruth) {
  Rng rng(6);
  for (const Scene scene : {Scene::kGeneral, Scene::kForward, Scene::kOmnidirectional, Scene::kPlanar}) {
    int wrong = 0;
    for (int i = 0; i < 1000; ++i) {
      const FivePointProblem problem = random_five_points(rng, scene);
      Rigid3 pose;
      const int in_front = choose_pose(-problem.essential(), problem.bearings0, problem.bearings1, &pose);
      const double error = rotation_angle(pose.rotation * problem.cam1_from_cam0.rotation.conjugate()) +
                           (pose.translation - problem.cam1_from_cam0.translation).norm();
      EXPECT_EQ(in_front, 5);
      wrong += error > 1e-9;
    }
    EXPECT_EQ(wrong, 0);
  }
  Rigid3 pose;
  EXPECT_EQ(choose_pose(random_five_points(rng).essential(), {}, {}, &pose), 0);
}

}  // namespace
}  // namespace raysfm
