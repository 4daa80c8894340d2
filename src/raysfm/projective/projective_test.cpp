#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <opencv2/calib3d.hpp>

#include "raysfm/projective/absolute_quadric.h"
#include "raysfm/projective/eight_point.h"
#include "raysfm/projective/optimal_triangulation.h"
#include "raysfm/projective/projective_adjustment.h"
#include "raysfm/projective/projective_resection.h"
#include "support/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::Cube;
using test_scenes::make_cube;

std::vector<Eigen::Vector2d> pixels_of(const Cube& cube, int image) {
  std::vector<Eigen::Vector2d> pixels;
  for (int k = 0; k < cube.tracks.size(); ++k) {
    if (cube.tracks.image[k] == image) pixels.push_back(cube.tracks.pixel[k]);
  }
  return pixels;
}

Matrix34d true_view(const Cube& cube, int j) {
  Matrix34d rt;
  rt << cube.truth.cam_from_world[j].rotation.toRotationMatrix(), cube.truth.cam_from_world[j].translation;
  return cube.truth.lenses[j].matrix() * rt;
}

TEST(EightPoint, EpipolarConstraintHoldsAndRankIsTwo) {
  Rng rng(1);
  const Cube cube = make_cube({.images = 2}, &rng);
  const auto a = pixels_of(cube, 0), b = pixels_of(cube, 1);
  Eigen::Matrix3d f;
  ASSERT_TRUE(fundamental_from_points(a, b, &f));
  for (size_t i = 0; i < a.size(); ++i) EXPECT_LT(sampson_error2(f, a[i], b[i]), 1e-16);
  EXPECT_NEAR(f.determinant(), 0, 1e-18);
  EXPECT_FALSE(fundamental_from_points(std::span(a).first(7), std::span(b).first(7), &f));
}

TEST(EightPoint, CanonicalViewsHaveTheGeometryOfF) {
  Rng rng(2);
  const Cube cube = make_cube({.images = 2}, &rng);
  const auto a = pixels_of(cube, 0), b = pixels_of(cube, 1);
  Eigen::Matrix3d f;
  ASSERT_TRUE(fundamental_from_points(a, b, &f));
  Matrix34d first = Matrix34d::Zero();
  first.leftCols<3>().setIdentity();
  const std::array views = {first, second_view(f)};
  for (size_t i = 0; i < a.size(); ++i) {
    const std::array pixels = {a[i], b[i]};
    Eigen::Vector4d x;
    ASSERT_TRUE(triangulate_projective(views, pixels, &x));
    for (int v = 0; v < 2; ++v) EXPECT_LT(((views[v] * x).hnormalized() - pixels[v]).norm(), 1e-6);
  }
}

TEST(OptimalTriangulation, CorrectionIsThatOfOpenCV) {
  Rng rng(3);
  Cube cube = make_cube({.images = 2}, &rng);
  auto a = pixels_of(cube, 0), b = pixels_of(cube, 1);
  // About the centre, at unit size.
  for (auto* side : {&a, &b}) {
    for (Eigen::Vector2d& p : *side) p = (p - Eigen::Vector2d(250, 250)) / 250;
  }
  Eigen::Matrix3d f;
  ASSERT_TRUE(fundamental_from_points(a, b, &f));
  cv::Mat f_cv(3, 3, CV_64F), a_cv(1, int(a.size()), CV_64FC2), b_cv(1, int(a.size()), CV_64FC2), a_new,
      b_new;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) f_cv.at<double>(r, c) = f(r, c);
  }
  for (size_t i = 0; i < a.size(); ++i) {
    a[i] += 0.01 * Eigen::Vector2d(rng.normal(), rng.normal());
    b[i] += 0.01 * Eigen::Vector2d(rng.normal(), rng.normal());
    a_cv.at<cv::Vec2d>(int(i)) = {a[i].x(), a[i].y()};
    b_cv.at<cv::Vec2d>(int(i)) = {b[i].x(), b[i].y()};
  }
  cv::correctMatches(f_cv, a_cv, b_cv, a_new, b_new);
  for (size_t i = 0; i < a.size(); ++i) {
    Eigen::Vector2d x = a[i], y = b[i];
    ASSERT_TRUE(correct_match(f, &x, &y));
    EXPECT_NEAR(y.homogeneous().dot(f * x.homogeneous()), 0, 1e-9);
    const cv::Vec2d of_a = a_new.at<cv::Vec2d>(int(i)), of_b = b_new.at<cv::Vec2d>(int(i));
    EXPECT_NEAR((x - Eigen::Vector2d(of_a[0], of_a[1])).norm(), 0, 1e-5);
    EXPECT_NEAR((y - Eigen::Vector2d(of_b[0], of_b[1])).norm(), 0, 1e-5);
  }
}

TEST(ProjectiveResection, FindsTheView) {
  Rng rng(4);
  const Cube cube = make_cube({.images = 1, .points = 6}, &rng);
  std::vector<Eigen::Vector4d> points;
  for (const Eigen::Vector3d& x : cube.truth.points) points.push_back(x.homogeneous());
  Matrix34d view;
  const auto pixels = pixels_of(cube, 0);
  ASSERT_TRUE(view_from_points(points, pixels, &view));
  const Matrix34d truth = true_view(cube, 0).normalized();
  EXPECT_LT(std::min((view - truth).norm(), (view + truth).norm()), 1e-7);
  EXPECT_FALSE(view_from_points(std::span(points).first(5), std::span(pixels).first(5), &view));
}

// The true scene seen through a projective map of space.
ProjectiveScene distorted(const Cube& cube, Rng* rng) {
  Eigen::Matrix4d map = Eigen::Matrix4d::Identity();
  for (int k = 0; k < 16; ++k) map.data()[k] += 0.1 * rng->normal();
  ProjectiveScene scene;
  for (int j = 0; j < cube.tracks.image_count; ++j)
    scene.views.push_back((true_view(cube, j) * map.inverse()).normalized());
  for (const Eigen::Vector3d& x : cube.truth.points)
    scene.points.push_back((map * x.homogeneous()).normalized());
  return scene;
}

// Half the image's side is the unit of length, its centre the origin.
Cube in_units(Cube cube) {
  for (Lens& lens : cube.truth.lenses)
    lens = {lens.fx / 250, lens.fy / 250, lens.cx / 250 - 1, lens.cy / 250 - 1, 0};
  test_scenes::project_all(cube.truth, &cube.tracks);
  return cube;
}

TEST(AbsoluteQuadric, UpgradeIsExactWhereItsAssumptionsHold) {
  Rng rng(5);
  const Cube cube = in_units(make_cube({.images = 6, .zooming = true}, &rng));
  const ProjectiveScene scene = distorted(cube, &rng);
  const ObservationIndex index = index_observations(cube.tracks, {}, nullptr, 6, 2);
  const auto upgrade = metric_upgrade(scene.views, 4.0, 100.0);
  ASSERT_TRUE(upgrade);
  double in_front = 0;
  const auto metric = upgraded_scene(scene, *upgrade, index, &in_front);
  ASSERT_TRUE(metric);
  EXPECT_EQ(in_front, 1.0);
  for (int j = 0; j < 6; ++j) EXPECT_NEAR(metric->lenses[j].fx, cube.truth.lenses[j].fx, 1e-3);
  EXPECT_LT(test_scenes::structure_error(metric->points, cube.truth.points), 1e-3);
}

TEST(ProjectiveAdjustment, ReachesZeroAndLeavesNoFreeDirectionUndamped) {
  Rng rng(6);
  const Cube cube = in_units(make_cube({.images = 5}, &rng));
  ProjectiveScene scene = distorted(cube, &rng);
  for (Matrix34d& view : scene.views) {
    for (int k = 0; k < 12; ++k) view.data()[k] += 1e-4 * rng.normal();
  }
  const ObservationIndex index = index_observations(cube.tracks, {}, nullptr, 6, 2);
  const LmSummary summary =
      adjust_projective(index, {}, {.max_iterations = 50, .min_relative_decrease = 1e-12}, &scene);
  EXPECT_GT(summary.initial_cost, 1e-6);
  EXPECT_LT(summary.final_cost, 1e-18);
}

}  // namespace
}  // namespace raysfm
