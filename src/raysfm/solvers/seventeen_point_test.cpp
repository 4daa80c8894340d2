#include "raysfm/solvers/seventeen_point.h"

#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <limits>

#include "raysfm/core/random.h"
#include "raysfm/solvers/translation_scale.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

using Eigen::Matrix3d;
using Eigen::Vector3d;

struct SeventeenPointProblem {
  std::vector<Ray> rays0, rays1;
  Rigid3 rig1_from_rig0;
};

std::vector<Vector3d> centres(CentreClass type, Rng& rng) {
  const Vector3d a = normal_vector(rng), b = normal_vector(rng);
  if (type == CentreClass::kCentral) return {a};
  if (type == CentreClass::kAxial) return {a, b, 0.3 * a + 0.7 * b};
  return {a, b, normal_vector(rng), normal_vector(rng)};
}

// Matches that stay in one camera, or go anywhere.
SeventeenPointProblem make_problem(CentreClass type, bool simple, int count, Rng& rng, double noise = 0) {
  const std::vector<Vector3d> origins = centres(type, rng);
  const auto any = [&] { return origins[rng.index(static_cast<uint32_t>(origins.size()))]; };
  SeventeenPointProblem problem;
  problem.rig1_from_rig0 = {exp_so3(0.5 * normal_vector(rng)), normal_vector(rng)};
  for (int i = 0; i < count; ++i) {
    const Vector3d point = 6 * normal_vector(rng);
    const Vector3d origin0 = any(), origin1 = simple ? origin0 : any();
    const Vector3d seen0 = (point - origin0).normalized() + noise * normal_vector(rng);
    const Vector3d seen1 =
        (problem.rig1_from_rig0 * point - origin1).normalized() + noise * normal_vector(rng);
    problem.rays0.push_back({origin0, seen0.normalized()});
    problem.rays1.push_back({origin1, seen1.normalized()});
  }
  return problem;
}

Eigen::MatrixXd pless_system(const SeventeenPointProblem& problem) {
  Eigen::MatrixXd system(problem.rays0.size(), 18);
  for (size_t i = 0; i < problem.rays0.size(); ++i) {
    system.row(i) = pless_row(problem.rays0[i], problem.rays1[i]);
  }
  return system;
}

int kernel_dimension(const Eigen::MatrixXd& system) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(system);
  int dimension = 18 - static_cast<int>(svd.singularValues().size());
  for (const double value : svd.singularValues()) dimension += value < 1e-9 * svd.singularValues()[0];
  return dimension;
}

class Pless : public testing::TestWithParam<std::tuple<CentreClass, bool>> {
 protected:
  CentreClass type_ = std::get<0>(GetParam());
  bool simple_ = std::get<1>(GetParam());
};

TEST_P(Pless, ClassAndKernelAreThoseOfThePaper) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    Rng rng(seed, 1);
    const SeventeenPointProblem problem = make_problem(type_, simple_, 40, rng);
    const RayClass found = classify_rays(problem.rays0, problem.rays1);
    EXPECT_EQ(found.centres, type_);
    const bool central = type_ == CentreClass::kCentral;
    EXPECT_EQ(found.simple, simple_ || central);
    const int expected = central ? 10 : type_ == CentreClass::kAxial ? (simple_ ? 4 : 2) : (simple_ ? 2 : 1);
    EXPECT_EQ(kernel_dimension(pless_system(problem)), expected);
    EXPECT_EQ(found.kernel_dimension(), expected);
  }
}

// Appendix B: they solve the equation of every pair of rays, matched or not.
TEST_P(Pless, ExactSolutionsHoldForAnyDirections) {
  Rng rng(2);
  SeventeenPointProblem problem = make_problem(type_, simple_, 40, rng);
  for (Ray& ray : problem.rays1) ray.direction = normal_vector(rng).normalized();
  const Eigen::MatrixXd exact = exact_pless_solutions(classify_rays(problem.rays0, problem.rays1));
  const Eigen::MatrixXd system = pless_system(problem);
  EXPECT_EQ(exact.cols(), kernel_dimension(system));
  if (exact.cols() == 0) return;
  EXPECT_LT((system * exact).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((exact.transpose() * exact - Eigen::MatrixXd::Identity(exact.cols(), exact.cols())).norm(),
            1e-12);
}

double best_rotation_error(const SeventeenPointProblem& problem, int count,
                           const std::array<Rigid3, 4>& poses, double* scale) {
  double best = std::numeric_limits<double>::infinity();
  for (int k = 0; k < count; ++k) {
    const double error = rotation_angle(poses[k].rotation * problem.rig1_from_rig0.rotation.conjugate());
    if (error >= best) continue;
    best = error;
    *scale = (poses[k].translation - problem.rig1_from_rig0.translation).norm();
  }
  return best;
}

TEST_P(Pless, TruthIsAmongTheSolutions) {
  int missed = 0;
  for (uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng(seed, 3);
    const SeventeenPointProblem problem = make_problem(type_, simple_, 17, rng);
    std::array<Rigid3, 4> poses;
    const int count =
        seventeen_point(problem.rays0, problem.rays1, classify_rays(problem.rays0, problem.rays1), &poses);
    EXPECT_GE(count, 1);
    double translation_error = 0;
    const double error = best_rotation_error(problem, count, poses, &translation_error);
    const bool scale_is_right = type_ == CentreClass::kCentral || translation_error < 1e-4;
    missed += !(error < 1e-5 && scale_is_right);
  }
  EXPECT_LE(missed, 4);
}

// Three hundred matches with a milliradian of noise; the best fit comes first but for a central camera, where
// the four decompositions fit alike.
TEST_P(Pless, ManyNoisyMatchesGiveTheMotion) {
  if (type_ == CentreClass::kCentral) return;
  std::vector<double> errors;
  for (uint64_t seed = 0; seed < 31; ++seed) {
    Rng rng(seed, 4);
    const SeventeenPointProblem problem = make_problem(type_, simple_, 300, rng, 1e-3);
    std::array<Rigid3, 4> poses;
    ASSERT_GE(
        seventeen_point(problem.rays0, problem.rays1, classify_rays(problem.rays0, problem.rays1), &poses),
        1);
    errors.push_back(rotation_angle(poses[0].rotation * problem.rig1_from_rig0.rotation.conjugate()));
  }
  std::nth_element(errors.begin(), errors.begin() + 15, errors.end());
  EXPECT_LT(errors[15], 5e-3);
}

INSTANTIATE_TEST_SUITE_P(All, Pless,
                         testing::Combine(testing::Values(CentreClass::kCentral, CentreClass::kAxial,
                                                          CentreClass::kNonAxial),
                                          testing::Bool()));

TEST(SeventeenPoint, DegenerateInputGivesNothingOrIsFinite) {
  Rng rng(5);
  std::array<Rigid3, 4> poses;
  SeventeenPointProblem problem = make_problem(CentreClass::kNonAxial, true, 16, rng);
  RayClass type = classify_rays(problem.rays0, problem.rays1);
  EXPECT_EQ(seventeen_point(problem.rays0, problem.rays1, type, &poses), 0);
  problem = make_problem(CentreClass::kNonAxial, true, 17, rng);
  type = classify_rays(problem.rays0, problem.rays1);
  problem.rays0[3].direction.y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(seventeen_point(problem.rays0, problem.rays1, type, &poses), 0);
  const std::vector<Ray> same(17, Ray{});
  const int count = seventeen_point(same, same, classify_rays(same, same), &poses);
  for (int k = 0; k < count; ++k) EXPECT_TRUE(poses[k].translation.allFinite());
}

TEST(RayClass, NamesItsCentreAndAxis) {
  std::vector<Ray> rays;
  for (int i = 0; i < 11; ++i) rays.push_back({Vector3d(1 + 0.1 * i, 2, 3), Vector3d::UnitX()});
  const RayClass found = classify_rays(rays, rays);
  EXPECT_EQ(found.centres, CentreClass::kAxial);
  EXPECT_LT((found.centre - Vector3d(1.5, 2, 3)).norm(), 1e-14);
  EXPECT_NEAR(std::abs(found.axis.x()), 1, 1e-14);
  EXPECT_NEAR(found.spread, std::sqrt(0.1), 1e-12);
  EXPECT_STREQ(name_of(found.centres), "axial");
  EXPECT_EQ(classify_rays({}, {}).centres, CentreClass::kCentral);
}

TEST(TranslationScale, OfAMatchIsTheTrueOne) {
  Rng rng(6);
  for (int i = 0; i < 100; ++i) {
    const Matrix3d rotation = exp_so3(0.3 * normal_vector(rng)).toRotationMatrix();
    const Vector3d start = normal_vector(rng), direction = normal_vector(rng).normalized();
    const double truth = rng.uniform(0.1, 5);
    const Vector3d point = 8 * normal_vector(rng), origin0 = normal_vector(rng), origin1 = normal_vector(rng);
    const Vector3d seen1 = rotation * point + start + truth * direction - origin1;
    const TranslationScale scale = translation_scale(
        rotation, start, direction, {origin0, (point - origin0).normalized()}, {origin1, seen1.normalized()});
    EXPECT_NEAR(scale.offset + truth * scale.slope, 0, 1e-12);
    EXPECT_GT(std::abs(scale.slope), 1e-6);
  }
}

}  // namespace
}  // namespace raysfm
