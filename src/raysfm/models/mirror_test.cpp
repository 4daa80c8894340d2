#include "raysfm/models/mirror.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "support/model_fixtures.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using testing_support::fixtures;
using testing_support::shared_data;

template <typename Visit>
void for_each_pixel(Visit visit) {
  for (double v = -0.5; v <= 479.5; v += 8) {
    for (double u = -0.5; u <= 639.5; u += 8) visit(Eigen::Vector2d(u, v));
  }
}

// The point lies on the pixel's perspective ray and on the surface; incoming and outgoing direction make
// equal angles with the normal, in one plane with it. The normal is from differences of the surface's height.
TEST(Mirror, ReflectsOnItsSurface) {
  for (const Mirror& mirror : fixtures<Mirror>()) {
    const auto height = [&](double x, double y) {
      const double r2 = x * x + y * y;
      return r2 / (mirror.radius + std::sqrt(mirror.radius * mirror.radius - (1 + mirror.conic) * r2));
    };
    int seen = 0;
    for_each_pixel([&](const Eigen::Vector2d& pixel) {
      Ray ray;
      if (!mirror.ray(pixel, &ray)) return;
      ++seen;
      const Eigen::Vector3d in(ray.origin.x() / ray.origin.z(), ray.origin.y() / ray.origin.z(), 1);
      EXPECT_NEAR(mirror.fx * in.x() + mirror.cx, pixel.x(), 1e-9);
      EXPECT_NEAR(mirror.fy * in.y() + mirror.cy, pixel.y(), 1e-9);
      const Eigen::Vector3d p = mirror.rotation.transpose() * (ray.origin - mirror.apex);
      EXPECT_NEAR(p.z(), height(p.x(), p.y()), 1e-12);
      EXPECT_LE(p.head<2>().norm(), mirror.rim + 1e-12);
      constexpr double kStep = 1e-6;
      const Eigen::Vector3d normal =
          mirror.rotation *
          Eigen::Vector3d((height(p.x() + kStep, p.y()) - height(p.x() - kStep, p.y())) / (2 * kStep),
                          (height(p.x(), p.y() + kStep) - height(p.x(), p.y() - kStep)) / (2 * kStep), -1)
              .normalized();
      const Eigen::Vector3d incoming = in.normalized();
      EXPECT_NEAR(ray.direction.dot(normal), -incoming.dot(normal), 1e-8);
      EXPECT_GT(ray.direction.dot(normal), 0);
      EXPECT_LT((ray.direction - incoming).cross(normal).norm(), 1e-8);
    });
    EXPECT_GT(seen, 500);
  }
}

// A hyperboloid with the camera in its far focus: every ray, prolonged backwards, passes the near one.
TEST(Mirror, HyperboloidSeenFromItsFocusHasOneViewpoint) {
  Mirror mirror;
  mirror.fx = mirror.fy = 300;
  mirror.cx = 319.5, mirror.cy = 239.5;
  mirror.radius = 0.1, mirror.conic = -2.4, mirror.rim = 0.2;
  const double a = mirror.radius / (-1 - mirror.conic);
  const double c = std::sqrt(a * a + mirror.radius * mirror.radius / (-1 - mirror.conic));
  mirror.apex = {0, 0, a + c};
  const Eigen::Vector3d focus(0, 0, 2 * c);
  int seen = 0;
  for_each_pixel([&](const Eigen::Vector2d& pixel) {
    Ray ray;
    if (!mirror.ray(pixel, &ray)) return;
    ++seen;
    EXPECT_LT(ray.direction.cross(focus - ray.origin).norm(), 1e-12);
    EXPECT_LT(ray.direction.dot(focus - ray.origin), 0);
  });
  EXPECT_GT(seen, 1000);
}

TEST(Mirror, NothingBesideTheRimAndWhereTheCameraSeesItself) {
  Mirror mirror = fixtures<Mirror>()[0];
  mirror.apex = {0, 0, 0.4};
  Ray ray;
  // The pixel of the centre is reflected straight back.
  EXPECT_FALSE(mirror.ray({319.5, 239.5}, &ray));
  mirror.body = 0;
  ASSERT_TRUE(mirror.ray({319.5 + 1e-6, 239.5}, &ray));
  EXPECT_LT(ray.direction.z(), -0.999999);
  const double rim_z = 0.4 + 0.1 - std::sqrt(0.01 - mirror.rim * mirror.rim);
  const double at_rim = 319.5 + mirror.fx * mirror.rim / rim_z;
  EXPECT_TRUE(mirror.ray({at_rim - 0.01, 239.5}, &ray));
  EXPECT_FALSE(mirror.ray({at_rim + 0.01, 239.5}, &ray));
}

TEST(Mirror, NamesWhatCannotBe) {
  const auto problem_with = [](int index, double value) {
    auto numbers = fixtures<Mirror>()[0].parameters();
    numbers[index] = value;
    const auto problem = Mirror::from_parameters(numbers).problem();
    return problem ? std::string(problem->name) : std::string();
  };
  EXPECT_EQ(problem_with(4, 0), "mirror.radius");
  EXPECT_EQ(problem_with(4, -0.1), "mirror.radius");
  EXPECT_EQ(problem_with(6, 0), "mirror.rim");
  EXPECT_EQ(problem_with(6, 0.11), "mirror.rim");  // a sphere of 0.1 m ends there
  EXPECT_EQ(problem_with(9, -0.4), "mirror.apex[2]");
  EXPECT_EQ(problem_with(13, 0), "mirror.rotation[3]");
  EXPECT_EQ(problem_with(14, -1), "mirror.body");
  EXPECT_EQ(problem_with(5, -3), "");
}

// Blender's camera before a sphere mirror.
class RenderedMirror : public ::testing::Test {
 protected:
  Mirror mirror_ = Mirror::from_parameters(
      {1640, 1640, 319.5, 319.5, 0.1, 0, 0.083, 0.0025, -0.0015, 0.4, 0, 0, 0, 1, 0.022});
};

TEST_F(RenderedMirror, AgreesWithItsExactRays) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("rendered/mirror/rays.csv.gz");
  const std::string command = "gzip -dc '" + shared_data("rendered/mirror/rays.csv.gz").string() + "'";
  FILE* file = popen(command.c_str(), "r");
  ASSERT_TRUE(file);
  int compared = 0;
  char line[512];
  while (std::fgets(line, sizeof line, file)) {
    double u, v;
    Eigen::Vector3d start, direction;
    if (std::sscanf(line, "%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf", &u, &v, &start.x(), &start.y(), &start.z(),
                    &direction.x(), &direction.y(), &direction.z()) != 8) {
      continue;
    }
    ++compared;
    Ray ray;
    ASSERT_TRUE(mirror_.ray({u, v}, &ray)) << line;
    EXPECT_LT((ray.origin - start).norm(), 1e-6) << line;
    EXPECT_LT((ray.direction - direction).norm(), 1e-6) << line;
  }
  pclose(file);
  EXPECT_GT(compared, 3000);
}

// The mask is drawn without a ring of 1.5 px that sees the scene too.
TEST_F(RenderedMirror, SeesWhereItsMaskSays) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("rendered/mirror/mask.png");
  const cv::Mat mask = cv::imread(shared_data("rendered/mirror/mask.png").string(), cv::IMREAD_GRAYSCALE);
  ASSERT_EQ(mask.cols, 640);
  cv::Mat wider;
  cv::dilate(mask, wider, cv::getStructuringElement(cv::MORPH_ELLIPSE, {7, 7}));
  for (int v = 0; v < mask.rows; ++v) {
    for (int u = 0; u < mask.cols; ++u) {
      Ray ray;
      const bool seen = mirror_.ray({static_cast<double>(u), static_cast<double>(v)}, &ray);
      ASSERT_TRUE(seen || mask.at<uint8_t>(v, u) == 0) << u << ' ' << v;
      ASSERT_TRUE(!seen || wider.at<uint8_t>(v, u) > 0) << u << ' ' << v;
    }
  }
}

}  // namespace
}  // namespace raysfm
