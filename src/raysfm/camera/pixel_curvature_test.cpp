#include "raysfm/camera/pixel_curvature.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "raysfm/core/random.h"
#include "support/model_fixtures.h"

namespace raysfm {
namespace {

using testing_support::fixture_camera;
using testing_support::fixtures;

// Rays a few pixels about a pixel; false where one of them is none.
bool rays_about(const Camera& camera, const Eigen::Vector2d& pixel, const Eigen::Vector2d& step,
                std::array<Eigen::Vector3d, 3>* directions) {
  for (int i = 0; i < 3; ++i) {
    Ray ray;
    if (!camera.ray(pixel + (i - 1) * step, &ray)) return false;
    (*directions)[i] = ray.direction;
  }
  return true;
}

// What the symbols foretell of the rays about a pixel, against the rays: the part of their second difference
// across the ray, as a share of the first difference.
void expect_foretold(const Camera& camera) {
  const PixelCurvature curvature(camera);
  Rng random(7);
  std::vector<double> errors, bends;
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector2d pixel(random.uniform(8, camera.width - 9), random.uniform(8, camera.height - 9));
    const double angle = random.uniform(0, 2 * std::numbers::pi);
    const Eigen::Vector2d step = 4 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    std::array<Eigen::Vector3d, 3> along, x, y;
    if (!rays_about(camera, pixel, step, &along) || !rays_about(camera, pixel, {2, 0}, &x) ||
        !rays_about(camera, pixel, {0, 2}, &y)) {
      continue;
    }
    Eigen::Matrix<double, 3, 2> first;
    first << (x[2] - x[0]) / 4, (y[2] - y[0]) / 4;
    const Eigen::Vector3d second = along[2] - 2 * along[1] + along[0];
    const Eigen::Vector2d seen = (first.transpose() * first).inverse() * first.transpose() * second;
    const Eigen::Vector2d foretold = curvature.along(pixel, step * step.transpose());
    errors.push_back((foretold - seen).norm());
    bends.push_back(seen.norm());
  }
  ASSERT_GT(errors.size(), 300u);
  std::sort(errors.begin(), errors.end());
  std::sort(bends.begin(), bends.end());
  // Close to the rim of what a model sees symbols grow beyond all bounds.
  const size_t most = errors.size() * 95 / 100;
  EXPECT_LT(errors[most], 0.05 * bends[most] + 2e-4) << model_name(camera.model);
}

template <typename Model>
class PixelCurvatureOf : public testing::Test {};
using Models = testing::Types<Pinhole, Radtan, Rational, KannalaBrandt, Unified, DoubleSphere, Eucm, OCam,
                              Equirectangular, Mirror>;
TYPED_TEST_SUITE(PixelCurvatureOf, Models);

TYPED_TEST(PixelCurvatureOf, ForetellsTheRaysAboutAPixel) {
  for (const TypeParam& model : fixtures<TypeParam>()) expect_foretold(fixture_camera(model));
}

// A pinhole's ray is (u, v, 1) normalised: across it, the second difference along a step is -2 (step . p) /
// |p|^2 step, with p = (u, v, 1) in units of the focal length.
TEST(PixelCurvature, IsThatOfThePerspective) {
  const Pinhole model{300, 300, 319.5, 239.5};
  const PixelCurvature curvature(fixture_camera(model));
  const Eigen::Vector2d pixel(500, 100), place = (pixel - Eigen::Vector2d(319.5, 239.5)) / 300;
  for (const Eigen::Vector2d& step : {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 2), Eigen::Vector2d(3, -1)}) {
    const Eigen::Vector2d expected = -2 * step.dot(place) / 300 / (1 + place.squaredNorm()) * step;
    const Eigen::Vector2d found = curvature.along(pixel, step * step.transpose());
    EXPECT_LT((found - expected).norm(), 0.01 * expected.norm()) << step.transpose();
  }
}

TEST(PixelCurvature, IsThereForTheSmallestImagesAndBesideThem) {
  Camera camera = fixture_camera(fixtures<Pinhole>()[0]);
  camera.width = camera.height = 1;
  EXPECT_TRUE(PixelCurvature(camera).along({0, 0}, Eigen::Matrix2d::Identity()).allFinite());
  EXPECT_TRUE(PixelCurvature(camera).along({1e9, -1e9}, Eigen::Matrix2d::Identity()).allFinite());
}

}  // namespace
}  // namespace raysfm
