// The property suite of camera models: every model of the variant that numbers describe passes it. Ray tables
// have theirs in ray_table_test.cpp.

#include "raysfm/models/model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "raysfm/camera/camera.h"
#include "raysfm/camera/model_check.h"
#include "raysfm/core/random.h"
#include "support/model_fixtures.h"

namespace raysfm {
namespace {

using testing_support::fixtures;
using testing_support::for_each_pixel;
using testing_support::kSeen;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <typename Model>
class AnyModelTest : public ::testing::Test {};
template <typename Model>
class ProjectiveModelTest : public ::testing::Test {};

// The models of the variant for which Condition::holds.
template <template <typename> typename Condition, typename Kept, typename... Models>
struct Filter {
  using type = Kept;
};
template <template <typename> typename Condition, typename... Kept, typename First, typename... Rest>
struct Filter<Condition, ::testing::Types<Kept...>, First, Rest...>
    : std::conditional_t<Condition<First>::value,
                         Filter<Condition, ::testing::Types<Kept..., First>, Rest...>,
                         Filter<Condition, ::testing::Types<Kept...>, Rest...>> {};
template <template <typename> typename Condition, typename Variant>
struct ModelsOf;
template <template <typename> typename Condition, typename... Models>
struct ModelsOf<Condition, std::variant<Models...>> {
  using type = typename Filter<Condition, ::testing::Types<>, Models...>::type;
};
template <typename Model>
struct IsParametric : std::bool_constant<ParametricModel<Model>> {};
template <typename Model>
struct IsProjective : std::bool_constant<ParametricModel<Model> && ProjectiveModel<Model>> {};

using ParametricModels = ModelsOf<IsParametric, CameraModel>::type;
using ProjectiveModels = ModelsOf<IsProjective, CameraModel>::type;
TYPED_TEST_SUITE(AnyModelTest, ParametricModels);
TYPED_TEST_SUITE(ProjectiveModelTest, ProjectiveModels);

TYPED_TEST(AnyModelTest, SeesItsShareOfTheImageAlongUnitDirections) {
  for (const TypeParam& model : fixtures<TypeParam>()) {
    EXPECT_FALSE(find_problem(model));
    int seen = 0, all = 0;
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Ray ray;
      ++all;
      if (!model_ray(model, pixel, &ray)) return;
      ++seen;
      EXPECT_NEAR(ray.direction.norm(), 1, 1e-14) << pixel.transpose();
      EXPECT_TRUE(ray.origin.allFinite());
      EXPECT_EQ(ray.origin.isZero(0), CentralModel<TypeParam>);
    });
    EXPECT_GE(seen, kSeen<TypeParam> * all);
  }
}

TYPED_TEST(AnyModelTest, PixelsWithoutARayAreRefused) {
  const Eigen::Vector2d pixels[] = {{kNan, 0}, {0, kNan}, {kInfinity, 0}, {0, -kInfinity}, {1e300, 1e300}};
  for (const TypeParam& model : fixtures<TypeParam>()) {
    for (const Eigen::Vector2d& pixel : pixels) {
      Ray ray;
      EXPECT_FALSE(model_ray(model, pixel, &ray)) << pixel.transpose();
    }
  }
}

// Whatever the numbers of a file: no crash, no endless loop, no ray that is not finite.
TYPED_TEST(AnyModelTest, AnyNumbersAreSafe) {
  constexpr double kValues[] = {0, 1, -1, 1e-300, 1e300, kNan, kInfinity, -0.5, 1.5, 300};
  Rng random(11);
  for (int trial = 0; trial < 400; ++trial) {
    auto numbers = fixtures<TypeParam>()[0].parameters();
    const int wild = trial % 3 == 0 ? static_cast<int>(numbers.size()) : 1 + trial % 3;
    for (int i = 0; i < wild; ++i) {
      numbers[random.index(static_cast<uint32_t>(numbers.size()))] =
          kValues[random.index(std::size(kValues))];
    }
    const TypeParam model = TypeParam::from_parameters(numbers);
    (void)find_problem(model);
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector2d pixel(random.uniform(-10, 650), random.uniform(-10, 490));
      Ray ray;
      if (model_ray(model, pixel, &ray)) {
        ASSERT_TRUE(ray.direction.allFinite()) << ::testing::PrintToString(numbers);
        ASSERT_NEAR(ray.direction.norm(), 1, 1e-9) << ::testing::PrintToString(numbers);
        ASSERT_TRUE(ray.origin.allFinite()) << ::testing::PrintToString(numbers);
      }
      if constexpr (ProjectiveModel<TypeParam>) {
        Eigen::Vector2d projected;
        (void)model.project({random.normal(), random.normal(), random.normal()}, &projected);
      }
    }
  }
}

TYPED_TEST(AnyModelTest, ParametersGiveTheSameModel) {
  for (const TypeParam& model : fixtures<TypeParam>()) {
    const TypeParam again = TypeParam::from_parameters(model.parameters());
    EXPECT_EQ(again.parameters(), model.parameters());
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Ray a, b;
      const bool seen = model_ray(model, pixel, &a);
      ASSERT_EQ(seen, model_ray(again, pixel, &b));
      if (!seen) return;
      EXPECT_EQ(a.origin, b.origin);
      EXPECT_EQ(a.direction, b.direction);
    });
  }
}

TYPED_TEST(AnyModelTest, NumbersThatAreNoneAreNamed) {
  for (size_t i = 0; i < TypeParam::kParameterNames.size(); ++i) {
    auto numbers = fixtures<TypeParam>()[0].parameters();
    numbers[i] = kNan;
    const auto problem = find_problem(TypeParam::from_parameters(numbers));
    ASSERT_TRUE(problem);
    EXPECT_EQ(problem->name, TypeParam::kParameterNames[i]);
  }
}

TEST(FindProblem, FocalLengthsArePositiveAndCentresNear) {
  EXPECT_FALSE(find_problem(Radtan{500, 500, 320, 240}));
  EXPECT_EQ(find_problem(Radtan{0, 500, 320, 240})->name, "fx");
  EXPECT_EQ(find_problem(Pinhole{500, -500, 320, 240})->name, "fy");
  EXPECT_EQ(find_problem(Pinhole{500, 2e6, 320, 240})->value, 2e6);
  EXPECT_EQ(find_problem(Eucm{500, 500, 2e6, 240, 0.5, 1})->name, "cx");
  EXPECT_EQ(find_problem(KannalaBrandt{500, 500, 320, -2e6})->name, "cy");
  EXPECT_EQ(find_problem(Eucm{500, 500, 320, 240, 1.5, 1})->name, "alpha");
  EXPECT_EQ(find_problem(Eucm{500, 500, 320, 240, 0.5, 0})->name, "beta");
  EXPECT_EQ(find_problem(DoubleSphere{500, 500, 320, 240, -1, 0.5})->name, "xi");
  EXPECT_EQ(find_problem(Unified{500, 500, 320, 240, -0.1})->name, "xi");
  EXPECT_EQ(find_problem(OCam{320, 240, 1, 0, 0, {-200}})->name, "a0");
  EXPECT_EQ(find_problem(OCam{320, 240, 1, 1, 1, {200}})->name, "c");
  EXPECT_FALSE(find_problem(CentralRayTable{}));
}

TYPED_TEST(ProjectiveModelTest, ProjectAfterUnprojectIsTheIdentity) {
  for (const TypeParam& model : fixtures<TypeParam>()) {
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Eigen::Vector3d direction;
      if (!model.unproject(pixel, &direction)) return;
      for (const double distance : {1e-3, 1.0, 1e4}) {
        Eigen::Vector2d again;
        ASSERT_TRUE(model.project(distance * direction, &again)) << pixel.transpose();
        EXPECT_LT((again - pixel).norm(), 1e-9) << pixel.transpose();
      }
    });
  }
}

TYPED_TEST(ProjectiveModelTest, JacobianAgreesWithDifferences) {
  for (const TypeParam& model : fixtures<TypeParam>()) {
    int compared = 0, seen = 0;
    const auto compare = [&](const Eigen::Vector3d& point) {
      Eigen::Vector2d projected;
      Eigen::Matrix<double, 2, 3> jacobian;
      ASSERT_TRUE(model.project(point, &projected, &jacobian));
      constexpr double kStep = 1e-6;
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(i);
        Eigen::Vector2d before, after;
        if (!model.project(point - step, &before) || !model.project(point + step, &after)) continue;
        if ((after - before).norm() > 100) continue;  // across the seam of a panorama
        const Eigen::Vector2d difference = (after - before) / (2 * kStep);
        EXPECT_LT((jacobian.col(i) - difference).norm(), 1e-5 * (1 + difference.norm()))
            << point.transpose() << " axis " << i;
        ++compared;
      }
    };
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Eigen::Vector3d direction;
      if (!model.unproject(pixel, &direction)) return;
      ++seen;
      compare(3 * direction);
    });
    EXPECT_GT(compared, 3 * 0.95 * seen);
    compare({0, 0, 3});
    compare({1e-7, -2e-7, 3});
    compare({1e-12, 1e-12, 3});
  }
}

TYPED_TEST(ProjectiveModelTest, PointsOutsideTheValidSetHaveNoPixel) {
  const Eigen::Vector3d points[] = {{0, 0, 0},         {0, kNan, 1},       {0, 0, kNan},
                                    {kInfinity, 0, 1}, {0, 0, -kInfinity}, {kInfinity, 0, kInfinity}};
  for (const TypeParam& model : fixtures<TypeParam>()) {
    for (const Eigen::Vector3d& point : points) {
      Eigen::Vector2d pixel;
      EXPECT_FALSE(model.project(point, &pixel)) << point.transpose();
    }
    if (std::is_same_v<TypeParam, Equirectangular>) continue;  // sees behind itself
    for (const Eigen::Vector3d& point : {Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(1e-12, 0, -1)}) {
      Eigen::Vector2d pixel;
      EXPECT_FALSE(model.project(point, &pixel)) << point.transpose();
    }
  }
}

TEST(PerspectiveModels, SeeNothingAtAndBeyondARightAngle) {
  const CameraModel models[] = {fixtures<Pinhole>()[0], fixtures<Radtan>()[0], fixtures<Rational>()[0]};
  for (const CameraModel& model : models) {
    const Camera camera = testing_support::fixture_camera(model);
    for (const Eigen::Vector3d& point :
         {Eigen::Vector3d(1, 1, -1e-9), Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(1e9, 0, 1e-9)}) {
      Eigen::Vector2d pixel;
      EXPECT_FALSE(camera.project(point, &pixel)) << point.transpose();
    }
  }
}

TYPED_TEST(ProjectiveModelTest, EveryDirectionProjectsBackOrNotAtAll) {
  Rng random(7);
  for (const TypeParam& model : fixtures<TypeParam>()) {
    int seen = 0;
    for (int i = 0; i < 4000; ++i) {
      const Eigen::Vector3d direction =
          Eigen::Vector3d(random.normal(), random.normal(), random.normal()).normalized();
      Eigen::Vector2d pixel;
      Eigen::Vector3d again;
      if (!model.project(direction, &pixel)) continue;
      // Where it leaves the image far behind, the pixel is no measure of the direction any more.
      if (pixel.norm() > 5000) continue;
      ++seen;
      ASSERT_TRUE(model.unproject(pixel, &again)) << direction.transpose();
      EXPECT_LT((again - direction).norm(), 1e-8) << direction.transpose();
    }
    EXPECT_GT(seen, 100);
  }
}

// d/dr (r + k1 r^3) = 0 at r^2 = -1 / (3 k1): there barrel distortion folds back.
TEST(OneToOneRadius, BarrelDistortionEndsWhereItFolds) {
  const Radtan model{400, 400, 320, 240, -0.4};
  EXPECT_NEAR(model.max_radius2, 1 / 1.2, 1e-9);
  const double limit = std::sqrt(model.max_radius2);
  Eigen::Vector2d pixel;
  Eigen::Vector3d direction;
  ASSERT_TRUE(model.project({0.9999 * limit, 0, 1}, &pixel));
  ASSERT_TRUE(model.unproject(pixel, &direction));
  EXPECT_NEAR(direction.x() / direction.z(), 0.9999 * limit, 1e-6);
  EXPECT_FALSE(model.project({1.0001 * limit, 0, 1}, &pixel));
  // r + k1 r^3 at the fold is the largest radius that any ray reaches.
  const double reach = 400 * limit * (1 - 0.4 * model.max_radius2);
  EXPECT_TRUE(model.unproject({320 + reach - 0.01, 240}, &direction));
  EXPECT_FALSE(model.unproject({320 + reach + 0.01, 240}, &direction));
  EXPECT_FALSE(model.unproject({320, 240 - 10 * reach}, &direction));
}

TEST(OneToOneRadius, TangentialDistortionAloneEndsAtItsBound) {
  const Radtan model{400, 400, 320, 240, 0, 0, 0.03, 0.04};
  EXPECT_NEAR(std::sqrt(model.max_radius2), 1 / (6 * 0.05), 1e-9);
}

TEST(OneToOneRadius, DenominatorsStayPositive) {
  const Rational model{400, 400, 320, 240, 0, 0, 0, 0, 0, -0.5, 0, 0};
  EXPECT_LE(model.max_radius2, 2);  // 1 - 0.5 r^2 > 0
  EXPECT_GT(model.max_radius2, 1.9);
}

TEST(OneToOneRadius, NothingIsValidWithoutNumbers) {
  EXPECT_EQ((Radtan{400, 400, 320, 240, kNan}.max_radius2), 0);
  Eigen::Vector2d pixel;
  EXPECT_FALSE((Radtan{400, 400, 320, 240, kNan}.project({0, 0, 1}, &pixel)));
}

// The Jacobian of the distortion has a positive determinant all over the valid disc, whatever the
// coefficients.
TEST(OneToOneRadius, TheJacobianIsPositiveInside) {
  Rng random(3);
  for (int trial = 0; trial < 300; ++trial) {
    const Radtan model{1,
                       1,
                       0,
                       0,
                       random.normal(),
                       random.normal(),
                       0.05 * random.normal(),
                       0.05 * random.normal(),
                       random.normal()};
    const double limit = std::min(std::sqrt(model.max_radius2), 20.0);
    for (int i = 0; i < 200; ++i) {
      const double r = limit * (1 - 1e-9) * std::sqrt(random.uniform());
      const double angle = random.uniform(0, 2 * std::numbers::pi);
      Eigen::Vector2d pixel;
      Eigen::Matrix<double, 2, 3> jacobian;
      ASSERT_TRUE(model.project({r * std::cos(angle), r * std::sin(angle), 1}, &pixel, &jacobian));
      ASSERT_GT(jacobian.leftCols<2>().determinant(), 0) << "trial " << trial;
    }
  }
}

// A slit camera: a stand-in for models that are not central and cannot project.
struct SlitModel {
  static constexpr std::string_view kName = "slit";
  bool ray(const Eigen::Vector2d& pixel, Ray* ray) const {
    *ray = {Eigen::Vector3d(pixel.x(), 0, 0), Eigen::Vector3d::UnitZ()};
    return pixel.x() >= 0;
  }
};
static_assert(NonCentralModel<SlitModel> && !CentralModel<SlitModel> && !ProjectiveModel<SlitModel>);

TEST(ModelRay, ServesNonCentralModels) {
  Ray ray;
  ASSERT_TRUE(model_ray(SlitModel{}, {3, 4}, &ray));
  EXPECT_EQ(ray.origin, Eigen::Vector3d(3, 0, 0));
  EXPECT_FALSE(model_ray(SlitModel{}, {-3, 4}, &ray));
}

}  // namespace
}  // namespace raysfm
