#include "raysfm/lenses/intrinsics_free.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "support/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::add_noise;
using test_scenes::Cube;
using test_scenes::make_cube;
using test_scenes::perturbed;

LensAdjustmentOptions options_for(bool equal, ConstraintMethod method, CostSpace space) {
  LensAdjustmentOptions options;
  options.constraints = {.zero_skew = true, .unit_aspect = true, .equal = equal};
  options.method = method;
  options.space = space;
  return options;
}

// The state moved by a step as the problem moves it.
UncalibratedScene moved(const UncalibratedScene& scene, const Eigen::VectorXd& step) {
  UncalibratedScene result = scene;
  const int images = static_cast<int>(scene.cam_from_world.size());
  for (int j = 0; j < images; ++j) {
    result.cam_from_world[j] = retract(scene.cam_from_world[j], step.segment<6>(6 * j));
  }
  for (size_t i = 0; i < scene.points.size(); ++i) result.points[i] += step.segment<3>(6 * images + 3 * i);
  return result;
}

Eigen::VectorXd residual_vector(IntrinsicsFreeProblem* problem, UncalibratedScene scene) {
  const std::vector<double> r = problem->residuals(&scene);
  return Eigen::Map<const Eigen::VectorXd>(r.data(), static_cast<Eigen::Index>(r.size()));
}

// Central differences; columns as in step().
Eigen::MatrixXd numeric_jacobian(IntrinsicsFreeProblem* problem, const UncalibratedScene& scene) {
  constexpr double kStep = 1e-6;
  const int count = static_cast<int>(6 * scene.cam_from_world.size() + 3 * scene.points.size());
  Eigen::MatrixXd jacobian(residual_vector(problem, scene).size(), count);
  for (int k = 0; k < count; ++k) {
    const Eigen::VectorXd e = kStep * Eigen::VectorXd::Unit(count, k);
    jacobian.col(k) =
        (residual_vector(problem, moved(scene, e)) - residual_vector(problem, moved(scene, -e))) /
        (2 * kStep);
  }
  return jacobian;
}

// Removes some observations so that images differ in what they see.
void drop_some(PointTracks* tracks) {
  PointTracks kept = *tracks;
  kept.image.clear(), kept.point.clear(), kept.pixel.clear();
  for (int k = 0; k < tracks->size(); ++k) {
    if ((7 * tracks->image[k] + 3 * tracks->point[k]) % 5 == 0) continue;
    kept.add(tracks->image[k], tracks->point[k], tracks->pixel[k]);
  }
  *tracks = kept;
}

struct MethodCase {
  const char* name;
  bool equal;
  ConstraintMethod method;
  CostSpace space;
};
void PrintTo(const MethodCase& c, std::ostream* out) {
  *out << c.name;
}

class DenseReference : public testing::TestWithParam<MethodCase> {};

// The step of the sparse solution against dense normal equations from numeric derivatives: it tests the
// derivatives through the moments, the rank-six structure, missing data, weights and multipliers at once.
TEST_P(DenseReference, StepIsThatOfTheDenseSystem) {
  Rng rng(5);
  Cube cube = make_cube({.images = 5, .points = 12, .zooming = !GetParam().equal}, &rng);
  drop_some(&cube.tracks);
  add_noise(2.0, &rng, &cube.tracks);
  const UncalibratedScene start = perturbed(cube.truth, 0.02, &rng);
  std::vector<double> weights(cube.tracks.size());
  for (double& w : weights) w = rng.uniform(0.5, 1.5);
  const ObservationIndex index = index_observations(cube.tracks, weights, &start, kMinPointsPerImage, 2);
  ASSERT_EQ(index.image_count(), 5);
  ASSERT_EQ(index.point_count(), 12);
  LensAdjustmentOptions options = options_for(GetParam().equal, GetParam().method, GetParam().space);
  options.constraint_weight = 2;  // of the size of the rest, so that neither hides an error of the other
  IntrinsicsFreeProblem problem(index, options, start);
  ASSERT_TRUE(problem.valid());
  const double cost = problem.linearize();

  const Eigen::VectorXd r = residual_vector(&problem, start);
  EXPECT_NEAR(cost, 0.5 * r.squaredNorm(), 1e-9 * cost);
  const Eigen::MatrixXd jacobian = numeric_jacobian(&problem, start);
  problem.linearize();
  constexpr double kDamping = 1e-2;
  ASSERT_TRUE(problem.solve(kDamping).valid || GetParam().method == ConstraintMethod::kLagrange);
  const Eigen::VectorXd step = problem.step();

  const int n = static_cast<int>(jacobian.cols()), rows = static_cast<int>(problem.rows().size());
  const int soft = static_cast<int>(r.size()) - (options.method == ConstraintMethod::kLagrange ? rows : 0);
  const int hard = static_cast<int>(r.size()) - soft;
  Eigen::MatrixXd kkt = Eigen::MatrixXd::Zero(n + hard, n + hard);
  const Eigen::MatrixXd j_soft = jacobian.topRows(soft);
  kkt.topLeftCorner(n, n) = j_soft.transpose() * j_soft;
  kkt.topLeftCorner(n, n).diagonal() += kDamping * problem.damping_scale();
  kkt.topRightCorner(n, hard) = jacobian.bottomRows(hard).transpose();
  kkt.bottomLeftCorner(hard, n) = jacobian.bottomRows(hard);
  Eigen::VectorXd right(n + hard);
  right << -j_soft.transpose() * r.head(soft), -r.tail(hard);
  const Eigen::VectorXd expected = kkt.fullPivLu().solve(right).head(n);
  EXPECT_LT((step - expected).norm(), 2e-5 * expected.norm());
}

// What the step promises is the cost lost by the quadratic model.
TEST_P(DenseReference, PromisedDecreaseIsThatOfTheModel) {
  Rng rng(6);
  Cube cube = make_cube({.images = 4, .points = 12, .zooming = !GetParam().equal}, &rng);
  add_noise(1.0, &rng, &cube.tracks);
  const UncalibratedScene start = perturbed(cube.truth, 0.01, &rng);
  const ObservationIndex index = index_observations(cube.tracks, {}, &start, kMinPointsPerImage, 2);
  LensAdjustmentOptions options = options_for(GetParam().equal, GetParam().method, GetParam().space);
  options.constraint_weight = 10;
  IntrinsicsFreeProblem problem(index, options, start);
  const Eigen::MatrixXd jacobian = numeric_jacobian(&problem, start);
  const Eigen::VectorXd r = residual_vector(&problem, start);
  problem.linearize();
  const LmStep step = problem.solve(1e-2);
  const double model = 0.5 * r.squaredNorm() - 0.5 * (r + jacobian * problem.step()).squaredNorm();
  EXPECT_NEAR(step.decrease, model, 1e-4 * std::abs(model));
}

INSTANTIATE_TEST_SUITE_P(
    , DenseReference,
    testing::Values(MethodCase{"zoom_weights", false, ConstraintMethod::kWeights, CostSpace::kImage},
                    MethodCase{"fixed_weights", true, ConstraintMethod::kWeights, CostSpace::kImage},
                    MethodCase{"zoom_multipliers", false, ConstraintMethod::kLagrange, CostSpace::kImage},
                    MethodCase{"fixed_multipliers", true, ConstraintMethod::kLagrange, CostSpace::kImage},
                    MethodCase{"zoom_invariant", false, ConstraintMethod::kWeights, CostSpace::kInvariant}),
    [](const auto& info) { return std::string(info.param.name); });

// Singular values of the Jacobian below 1e-7 of the largest, its columns scaled to unit length.
int free_directions(const LensConstraints& constraints, int images) {
  Rng rng(7);
  const Cube cube =
      make_cube({.images = images, .points = 20, .zooming = true, .principal_point_spread = 20}, &rng);
  const ObservationIndex index = index_observations(cube.tracks, {}, &cube.truth, kMinPointsPerImage, 2);
  LensAdjustmentOptions options;
  options.constraints = constraints;
  IntrinsicsFreeProblem problem(index, options, cube.truth);
  Eigen::MatrixXd jacobian = numeric_jacobian(&problem, cube.truth);
  jacobian.colwise().normalize();
  const Eigen::VectorXd values = Eigen::BDCSVD<Eigen::MatrixXd>(jacobian).singularValues();
  return static_cast<int>((values.array() < 1e-7 * values[0]).count());
}

TEST(IntrinsicsFree, FifteenDirectionsAreFreeWithoutConstraintsAndSevenWith) {
  const LensConstraints none{.zero_skew = false, .unit_aspect = false};
  EXPECT_EQ(free_directions(none, 5), 15);
  EXPECT_EQ(free_directions({}, 5), 7);
  EXPECT_EQ(free_directions({}, 3), 9);  // 2 conditions for each of 3 images leave 2 of 8
}

TEST(IntrinsicsFree, MinimumOfImages) {
  EXPECT_EQ(min_images({.zero_skew = false, .unit_aspect = false}), 0);
  EXPECT_EQ(min_images({}), 4);
  EXPECT_EQ(min_images({.zero_skew = false, .unit_aspect = false, .equal = true}), 3);
  EXPECT_EQ(min_images({.zero_skew = true, .unit_aspect = true, .known_principal_point = true}), 2);
}

}  // namespace
}  // namespace raysfm
