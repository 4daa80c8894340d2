// Camera models against independent implementations: OpenCV's, the published functions of OCamCalib, and the
// defining equations solved by bisection.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/ccalib/omnidir.hpp>

#include "raysfm/camera/camera.h"
#include "support/model_fixtures.h"

namespace raysfm {
namespace {

using testing_support::fixtures;
using testing_support::for_each_pixel;

template <typename Model>
class PerspectiveOracleTest : public ::testing::Test {};
using PerspectiveModels = ::testing::Types<Pinhole, Radtan, Rational>;
TYPED_TEST_SUITE(PerspectiveOracleTest, PerspectiveModels);

// OpenCV's K and its coefficients k1 k2 p1 p2 k3 k4 k5 k6 from parameters in that order.
template <typename Model>
void to_opencv(const Model& model, cv::Matx33d* k, std::vector<double>* coefficients) {
  const auto p = model.parameters();
  *k = {p[0], 0, p[2], 0, p[1], p[3], 0, 0, 1};
  coefficients->assign(p.begin() + 4, p.end());
}

TYPED_TEST(PerspectiveOracleTest, AgreesWithOpenCv) {
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

TEST(KannalaBrandtOracle, AgreesWithOpenCvInFront) {
  for (const KannalaBrandt& model : fixtures<KannalaBrandt>()) {
    const cv::Matx33d k(model.fx, 0, model.cx, 0, model.fy, model.cy, 0, 0, 1);
    const cv::Vec4d coefficients(model.k1, model.k2, model.k3, model.k4);
    int compared = 0;
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Eigen::Vector3d direction;
      if (!model.unproject(pixel, &direction) || direction.z() < 0.02) return;
      ++compared;
      std::vector<cv::Point2d> projected, normalised;
      cv::fisheye::projectPoints(std::vector<cv::Point3d>{{direction.x(), direction.y(), direction.z()}},
                                 projected, cv::Vec3d(), cv::Vec3d(), k, coefficients);
      EXPECT_NEAR(projected[0].x, pixel.x(), 1e-8);
      EXPECT_NEAR(projected[0].y, pixel.y(), 1e-8);
      cv::fisheye::undistortPoints(std::vector<cv::Point2d>{{pixel.x(), pixel.y()}}, normalised, k,
                                   coefficients);
      // OpenCV stops at a step of 1e-8 rad.
      const Eigen::Vector3d theirs = Eigen::Vector3d(normalised[0].x, normalised[0].y, 1).normalized();
      EXPECT_LT((theirs - direction).norm(), 1e-7) << pixel.transpose();
    });
    EXPECT_GT(compared, 200);
  }
}

// Beyond 90 degrees, where OpenCV does not go: an equidistant lens puts a ray at f theta from the centre.
TEST(KannalaBrandtOracle, EquidistantBehindItself) {
  const KannalaBrandt model{100, 100, 300, 200};
  for (const double degrees : {89.0, 95.0, 120.0, 170.0}) {
    const double theta = degrees * std::numbers::pi / 180;
    const double azimuth = 0.1 * degrees;
    const Eigen::Vector3d point = 7 * Eigen::Vector3d(std::sin(theta) * std::cos(azimuth),
                                                      std::sin(theta) * std::sin(azimuth), std::cos(theta));
    Eigen::Vector2d pixel;
    ASSERT_TRUE(model.project(point, &pixel));
    EXPECT_NEAR(pixel.x(), 300 + 100 * theta * std::cos(azimuth), 1e-10);
    EXPECT_NEAR(pixel.y(), 200 + 100 * theta * std::sin(azimuth), 1e-10);
  }
  // theta + k1 theta^3 rises up to theta^2 = -1 / (3 k1).
  EXPECT_NEAR((KannalaBrandt{100, 100, 0, 0, -0.2}.max_angle), std::sqrt(1 / 0.6), 1e-12);
}

TEST(UnifiedOracle, AgreesWithOpenCv) {
  for (const Unified& model : fixtures<Unified>()) {
    const cv::Matx33d k(model.fx, 0, model.cx, 0, model.fy, model.cy, 0, 0, 1);
    const cv::Vec4d coefficients(model.k1, model.k2, model.p1, model.p2);
    int compared = 0;
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Eigen::Vector3d direction;
      if (!model.unproject(pixel, &direction)) return;
      ++compared;
      std::vector<cv::Point2d> projected;
      cv::omnidir::projectPoints(std::vector<cv::Point3d>{{direction.x(), direction.y(), direction.z()}},
                                 projected, cv::Vec3d(), cv::Vec3d(), k, model.xi, coefficients);
      EXPECT_NEAR(projected[0].x, pixel.x(), 1e-8);
      EXPECT_NEAR(projected[0].y, pixel.y(), 1e-8);
    });
    EXPECT_GT(compared, 800);
  }
}

// The sphere seen from a point outside of it ends where the rays touch it, from inside at the horizon.
TEST(UnifiedOracle, EndsWhereTheRaysTouchTheSphere) {
  const auto last_angle = [](double xi) {
    const Unified model{400, 400, 320, 240, xi};
    double low = 0, high = std::numbers::pi;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      Eigen::Vector2d pixel;
      (model.project({std::sin(middle), 0, std::cos(middle)}, &pixel) ? low : high) = middle;
    }
    return low;
  };
  EXPECT_NEAR(last_angle(1.6), std::acos(-1 / 1.6), 1e-6);
  EXPECT_NEAR(last_angle(0.5), std::acos(-0.5), 0.01);  // |m| < tan 89.9 degrees
}

// Angle off the axis at which a rising function of it has the value `wanted`, by bisection.
template <typename Radius>
double bisect(const Radius& radius, double last, double wanted) {
  double low = 0, high = last;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (radius(middle) < wanted ? low : high) = middle;
  }
  return low;
}

// Of a model with fx, fy, cx, cy and the normalised radius as a function of the angle off the axis.
template <typename Model, typename Radius>
void expect_radial_model(const Model& model, const Radius& radius, double last_angle) {
  int compared = 0;
  for_each_pixel([&](const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d m((pixel.x() - model.cx) / model.fx, (pixel.y() - model.cy) / model.fy);
    Eigen::Vector3d direction;
    const bool seen = model.unproject(pixel, &direction);
    EXPECT_EQ(seen, m.norm() < radius(last_angle)) << pixel.transpose();
    if (!seen) return;
    ++compared;
    const double theta = bisect(radius, last_angle, m.norm());
    const Eigen::Vector3d expected(std::sin(theta) * m.x() / m.norm(), std::sin(theta) * m.y() / m.norm(),
                                   std::cos(theta));
    EXPECT_LT((direction - expected).norm(), 1e-7) << pixel.transpose();
  });
  EXPECT_GT(compared, 800);
  for (const double azimuth : {0.3, 2.0, 4.5}) {
    const auto sees = [&](double theta) {
      Eigen::Vector2d pixel;
      return model.project(
          {std::sin(theta) * std::cos(azimuth), std::sin(theta) * std::sin(azimuth), std::cos(theta)},
          &pixel);
    };
    EXPECT_TRUE(sees(0.9999 * last_angle));
    EXPECT_FALSE(sees(1.0001 * last_angle));
  }
}

// Usenko et al. 2018, figure 3: the unit sphere, one shifted by xi, then the image plane shifted by
// alpha / (1 - alpha). The radius rises with the angle until the second sphere's rays touch it.
TEST(DoubleSphereOracle, AgreesWithItsGeometry) {
  for (const DoubleSphere& model : fixtures<DoubleSphere>()) {
    const auto radius = [&](double theta) {
      const double on_second = std::atan2(std::sin(theta), model.xi + std::cos(theta));
      return std::sin(on_second) / (model.alpha + (1 - model.alpha) * std::cos(on_second));
    };
    // That ray is at this angle from the second sphere's centre; alpha <= 0.5: the image plane's horizon.
    const double ratio =
        model.alpha > 0.5 ? (1 - model.alpha) / model.alpha : model.alpha / (1 - model.alpha);
    const double touching = std::acos(-ratio);
    const double last = bisect([&](double t) { return std::atan2(std::sin(t), model.xi + std::cos(t)); },
                               std::numbers::pi, touching);
    expect_radial_model(model, radius, last * (1 - 1e-12));
  }
}

// Khomutenko et al. 2016: the ellipsoid beta (x^2 + y^2) + z^2 = 1 in place of the sphere.
TEST(EucmOracle, AgreesWithItsGeometry) {
  for (const Eucm& model : fixtures<Eucm>()) {
    const auto radius = [&](double theta) {
      const double x = std::sin(theta), z = std::cos(theta);
      const double on_ellipsoid = 1 / std::sqrt(model.beta * x * x + z * z);
      return on_ellipsoid * x / (model.alpha + (1 - model.alpha) * on_ellipsoid * z);
    };
    const double ratio =
        model.alpha > 0.5 ? (1 - model.alpha) / model.alpha : model.alpha / (1 - model.alpha);
    const double last = std::atan2(std::sqrt((1 - ratio * ratio) / model.beta), -ratio);
    expect_radial_model(model, radius, last * (1 - 1e-12));
  }
}

// OCamCalib's cam2world, in its own axes: x along rows, y along columns, z away from the view.
TEST(OCamOracle, AgreesWithOCamCalibsAxes) {
  const OCam model = fixtures<OCam>()[0];
  const double xc = model.cy, yc = model.cx;
  const std::array<double, 5> ss = {-209.200757992065, 0, 0.00213741670953883, -4.2203617319086e-06,
                                    1.77146086919594e-08};
  Eigen::Matrix2d affine;
  affine << model.c, model.d, model.e, 1;
  for_each_pixel([&](const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d q = affine.fullPivLu().solve(Eigen::Vector2d(pixel.y() - xc, pixel.x() - yc));
    double z = 0;
    for (int i = 0; i < 5; ++i) z += ss[i] * std::pow(q.norm(), i);
    const Eigen::Vector3d theirs = Eigen::Vector3d(q.x(), q.y(), z).normalized();
    Eigen::Vector3d direction;
    ASSERT_TRUE(model.unproject(pixel, &direction));
    EXPECT_LT((direction - Eigen::Vector3d(theirs.y(), theirs.x(), -theirs.z())).norm(), 1e-12);
  });
}

// The inverse polynomial of the same calibration (MultiCol), good to some hundredths of a pixel.
TEST(OCamOracle, AgreesWithThePublishedInversePolynomial) {
  const OCam model = fixtures<OCam>()[0];
  const std::array<double, 12> inverse = {293.667187375663, 149.982043337335,  -10.448650568161,
                                          28.2295300683376, 7.13365723186292,  0.056303218962532,
                                          10.4144677485333, 0.166354960773665, -5.86858687381081,
                                          1.18165998645705, 3.1108311354746,   0.810799620714366};
  for (double theta = 0.2; theta < 1.5; theta += 0.1) {
    double rho = 0;
    for (size_t i = 0; i < inverse.size(); ++i) rho += inverse[i] * std::pow(theta - std::numbers::pi / 2, i);
    Eigen::Vector2d pixel;
    ASSERT_TRUE(model.project({std::sin(theta), 0, std::cos(theta)}, &pixel));
    EXPECT_LT((pixel - Eigen::Vector2d(model.cx + rho, model.cy + model.d * rho)).norm(), 0.1) << theta;
  }
}

// A turn about y, then a tilt up: longitude and latitude as angles of rotations.
TEST(EquirectangularOracle, AnglesAreRotations) {
  const Equirectangular model = Equirectangular::for_image(2000, 1000);
  for (double longitude = -3.1; longitude < 3.14; longitude += 0.3) {
    for (double latitude = -1.5; latitude < 1.55; latitude += 0.25) {
      const Eigen::Vector3d direction = Eigen::AngleAxisd(longitude, Eigen::Vector3d::UnitY()) *
                                        Eigen::AngleAxisd(-latitude, Eigen::Vector3d::UnitX()) *
                                        Eigen::Vector3d::UnitZ();
      Eigen::Vector2d pixel;
      ASSERT_TRUE(model.project(4 * direction, &pixel));
      EXPECT_NEAR(pixel.x(), 999.5 + longitude * 2000 / (2 * std::numbers::pi), 1e-9);
      EXPECT_NEAR(pixel.y(), 499.5 + latitude * 1000 / std::numbers::pi, 1e-9);
    }
  }
}

TEST(EquirectangularOracle, PixelsBeyondTheSeamSeeWhatTheOtherSideSees) {
  const Equirectangular model = Equirectangular::for_image(2000, 1000);
  Eigen::Vector3d here, there;
  ASSERT_TRUE(model.unproject({-3, 400}, &here));
  ASSERT_TRUE(model.unproject({1997, 400}, &there));
  EXPECT_LT((here - there).norm(), 1e-14);
  Eigen::Vector2d pixel;
  ASSERT_TRUE(model.project(here, &pixel));
  EXPECT_NEAR(pixel.x(), 1997, 1e-9);
}

}  // namespace
}  // namespace raysfm
