// The property suite of camera models: every model of the variant passes it.

#include "raysfm/camera/model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "raysfm/camera/camera.h"
#include "raysfm/core/random.h"

namespace raysfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Real calibrations, for images of 640 x 480 pixels of which the model sees every one.
template <typename Model>
std::vector<Model> fixtures();

template <>
std::vector<Pinhole> fixtures() {
  return {{526.24, 526.24, 319.5, 239.5}, {615, 480, 300, 260}, {40, 40, 319.5, 239.5}};
}

template <>
std::vector<Radtan> fixtures() {
  return {{517.306408, 516.469215, 318.64304, 255.313989, 0.262383, -0.953104, -0.005358, 0.002628, 1.163314},
          {458.654, 457.296, 367.215, 248.375, -0.28340811, 0.07395907, 0.00019359, 1.76187114e-05},
          {526.238, 526.238, 319.5, 239.5, -0.0274262},
          {526.238, 526.238, 319.5, 239.5}};
}

template <>
std::vector<Rational> fixtures() {
  return {{610, 605, 322, 241, 12.1, 21.3, 2e-4, -3e-4, 1.6, 12.4, 25.1, 6.2},
          {480, 481, 320, 240, 0.262383, -0.953104, -0.005358, 0.002628, 1.163314}};
}

template <typename Model>
class CameraModelTest : public ::testing::Test {};

template <typename Variant>
struct TypesOf;
template <typename... Models>
struct TypesOf<std::variant<Models...>> {
  using type = ::testing::Types<Models...>;
};
TYPED_TEST_SUITE(CameraModelTest, TypesOf<CameraModel>::type);

template <typename Visit>
void for_each_pixel(Visit visit) {
  for (double v = -0.5; v <= 479.5; v += 16) {
    for (double u = -0.5; u <= 639.5; u += 16) visit(Eigen::Vector2d(u, v));
  }
}

TYPED_TEST(CameraModelTest, ProjectAfterUnprojectIsTheIdentity) {
  for (const TypeParam& model : fixtures<TypeParam>()) {
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Eigen::Vector3d direction;
      ASSERT_TRUE(model.unproject(pixel, &direction)) << pixel.transpose();
      EXPECT_NEAR(direction.norm(), 1, 1e-14);
      for (const double distance : {1e-3, 1.0, 1e4}) {
        Eigen::Vector2d again;
        ASSERT_TRUE(model.project(distance * direction, &again)) << pixel.transpose();
        EXPECT_LT((again - pixel).norm(), 1e-9) << pixel.transpose();
      }
    });
  }
}

TYPED_TEST(CameraModelTest, JacobianAgreesWithDifferences) {
  for (const TypeParam& model : fixtures<TypeParam>()) {
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Eigen::Vector3d direction;
      ASSERT_TRUE(model.unproject(pixel, &direction));
      const Eigen::Vector3d point = 3 * direction;
      Eigen::Vector2d projected;
      Eigen::Matrix<double, 2, 3> jacobian;
      ASSERT_TRUE(model.project(point, &projected, &jacobian));
      constexpr double kStep = 1e-6;
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(i);
        Eigen::Vector2d before, after;
        ASSERT_TRUE(model.project(point - step, &before) && model.project(point + step, &after));
        const Eigen::Vector2d difference = (after - before) / (2 * kStep);
        EXPECT_LT((jacobian.col(i) - difference).norm(), 1e-5 * (1 + difference.norm()));
      }
    });
  }
}

TYPED_TEST(CameraModelTest, PointsOutsideTheValidSetHaveNoPixel) {
  const Eigen::Vector3d points[] = {
      {0, 0, 0},    {0, 0, -1},   {1, 1, -1e-9},     {1, 0, 0},          {1e9, 0, 1e-9},
      {0, kNan, 1}, {0, 0, kNan}, {kInfinity, 0, 1}, {0, 0, -kInfinity}, {kInfinity, 0, kInfinity}};
  for (const TypeParam& model : fixtures<TypeParam>()) {
    for (const Eigen::Vector3d& point : points) {
      Eigen::Vector2d pixel;
      EXPECT_FALSE(model.project(point, &pixel)) << point.transpose();
    }
  }
}

TYPED_TEST(CameraModelTest, PixelsWithoutARayAreRefused) {
  const Eigen::Vector2d pixels[] = {{kNan, 0}, {0, kNan}, {kInfinity, 0}, {0, -kInfinity}, {1e300, 1e300}};
  for (const TypeParam& model : fixtures<TypeParam>()) {
    for (const Eigen::Vector2d& pixel : pixels) {
      Eigen::Vector3d direction;
      EXPECT_FALSE(model.unproject(pixel, &direction)) << pixel.transpose();
    }
  }
}

TYPED_TEST(CameraModelTest, EveryDirectionProjectsBackOrNotAtAll) {
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

TYPED_TEST(CameraModelTest, ParametersGiveTheSameModel) {
  for (const TypeParam& model : fixtures<TypeParam>()) {
    const TypeParam again = TypeParam::from_parameters(model.parameters());
    EXPECT_EQ(again.parameters(), model.parameters());
    Eigen::Vector2d a, b;
    ASSERT_TRUE(model.project({0.1, -0.2, 1}, &a) && again.project({0.1, -0.2, 1}, &b));
    EXPECT_EQ(a, b);
  }
}

// OpenCV's K and its coefficients k1 k2 p1 p2 k3 k4 k5 k6 from parameters in that order.
template <typename Model>
void to_opencv(const Model& model, cv::Matx33d* k, std::vector<double>* coefficients) {
  const auto p = model.parameters();
  *k = {p[0], 0, p[2], 0, p[1], p[3], 0, 0, 1};
  coefficients->assign(p.begin() + 4, p.end());
}

TYPED_TEST(CameraModelTest, AgreesWithOpenCv) {
  for (const TypeParam& model : fixtures<TypeParam>()) {
    cv::Matx33d k;
    std::vector<double> coefficients;
    to_opencv(model, &k, &coefficients);
    int compared = 0, pixels_in_all = 0;
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Eigen::Vector3d direction;
      ASSERT_TRUE(model.unproject(pixel, &direction));
      const std::vector<cv::Point3d> points = {{direction.x(), direction.y(), direction.z()}};
      std::vector<cv::Point2d> projected;
      cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), k, coefficients, projected);
      EXPECT_NEAR(projected[0].x, pixel.x(), 1e-8);
      EXPECT_NEAR(projected[0].y, pixel.y(), 1e-8);

      const std::vector<cv::Point2d> pixels = {{pixel.x(), pixel.y()}};
      std::vector<cv::Point2d> normalised;
      cv::undistortPoints(pixels, normalised, k, coefficients, cv::noArray(), cv::noArray(),
                          cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 500, 1e-13));
      // OpenCV's fixed-point iteration does not converge everywhere; where it did, it projects to the pixel.
      std::vector<cv::Point2d> check;
      cv::projectPoints(std::vector<cv::Point3d>{{normalised[0].x, normalised[0].y, 1}}, cv::Vec3d(),
                        cv::Vec3d(), k, coefficients, check);
      ++pixels_in_all;
      if (cv::norm(check[0] - pixels[0]) > 1e-8) return;
      ++compared;
      EXPECT_NEAR(normalised[0].x, direction.x() / direction.z(), 1e-8);
      EXPECT_NEAR(normalised[0].y, direction.y() / direction.z(), 1e-8);
    });
    EXPECT_GT(compared, 0.8 * pixels_in_all);
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
  static constexpr size_t kRequired = 0;
  static constexpr std::array<std::string_view, 0> kParameterNames = {};
  std::array<double, 0> parameters() const { return {}; }
  static SlitModel from_parameters(const std::array<double, 0>&) { return {}; }
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
