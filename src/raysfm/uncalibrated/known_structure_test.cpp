#include "raysfm/uncalibrated/known_structure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "support/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::Cube;
using test_scenes::CubeOptions;

// A board of 9 x 6 points in the plane z = 0.2 of the world, seen by the cameras of a cube.
Cube make_board(const CubeOptions& options, Rng* rng) {
  Cube cube = test_scenes::make_cube(options, rng);
  cube.truth.points.clear();
  for (int i = 0; i < 54; ++i)
    cube.truth.points.emplace_back(0.12 * (i % 9) - 0.5, 0.12 * (i / 9) - 0.3, 0.2);
  test_scenes::project_all(cube.truth, &cube.tracks);
  return cube;
}

// Sees the points through a lens with distortion.
void project_distorted(const Cube& cube, const RadialDistortion& distortion, PointTracks* tracks) {
  for (int k = 0; k < tracks->size(); ++k) {
    const Eigen::Vector3d x =
        cube.truth.cam_from_world[tracks->image[k]] * cube.truth.points[tracks->point[k]];
    tracks->pixel[k] = cube.truth.lenses[tracks->image[k]].pixel(distortion(x.hnormalized()));
  }
}

double worst_focal_error(const UncalibratedReconstruction& result, const Cube& cube) {
  double worst = 0;
  for (size_t j = 0; j < cube.truth.lenses.size(); ++j) {
    worst = std::max(worst, std::abs(result.scene.lenses[j].fx / cube.truth.lenses[j].fx - 1));
  }
  return worst;
}

double worst_place_error(const UncalibratedReconstruction& result, const Cube& cube) {
  double worst = 0;
  for (size_t j = 0; j < cube.truth.lenses.size(); ++j) {
    const Eigen::Vector3d place = cube.truth.cam_from_world[j].inverse().translation;
    worst = std::max(worst, (result.scene.cam_from_world[j].inverse().translation - place).norm());
  }
  return worst;
}

TEST(KnownStructure, ExactWithoutNoiseForPlanesAndSolids) {
  for (const bool planar : {true, false}) {
    for (const bool zooming : {true, false}) {
      Rng rng(1);
      const CubeOptions options{.images = 5, .points = 30, .zooming = zooming};
      const Cube cube = planar ? make_board(options, &rng) : test_scenes::make_cube(options, &rng);
      const auto result = reconstruct_known(cube.tracks, cube.truth.points, {});
      ASSERT_TRUE(result.ok()) << result.error().message;
      EXPECT_EQ(result->zooming, zooming) << result->lens_evidence;
      EXPECT_LT(worst_focal_error(*result, cube), 1e-7);
      EXPECT_LT(worst_place_error(*result, cube), 1e-6);
      EXPECT_EQ(result->degenerate, "");
    }
  }
}

TEST(KnownStructure, DistortionAndWrongPointsAreBorne) {
  Rng rng(2);
  Cube cube = make_board({.images = 8}, &rng);
  const RadialDistortion truth{-1.5, 3};  // 9 pixels where the image is largest
  project_distorted(cube, truth, &cube.tracks);
  test_scenes::add_noise(0.1, &rng, &cube.tracks);
  for (int k = 0; k < cube.tracks.size(); k += 23) cube.tracks.pixel[k] += Eigen::Vector2d(40, -60);
  const auto result = reconstruct_known(cube.tracks, cube.truth.points, {});
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_FALSE(result->zooming) << result->lens_evidence;
  EXPECT_NEAR(result->scene.lenses[0].fx, 1000, 5 * result->lens_sigma[0][0]);
  EXPECT_LT(result->lens_sigma[0][0], 10);
  EXPECT_NEAR(result->radial.k1, truth.k1, 5 * result->radial_sigma.k1);
  EXPECT_LT(result->radial_sigma.k1, 0.5);
  for (int k = 0; k < cube.tracks.size(); ++k) EXPECT_EQ(result->inlier[k], k % 23 != 0) << k;
}

TEST(KnownStructure, AgreesWithOpenCvOnTheSameCorners) {
  Rng rng(3);
  Cube cube = make_board({.images = 6}, &rng);
  project_distorted(cube, {-0.8, 0.5}, &cube.tracks);
  test_scenes::add_noise(0.3, &rng, &cube.tracks);
  const auto result =
      reconstruct_known(cube.tracks, cube.truth.points,
                        {.lens = LensChange::kFixed, .max_error_px = 30, .principal_point_sigma = 0});
  ASSERT_TRUE(result.ok()) << result.error().message;
  std::vector<std::vector<cv::Point3f>> board(6);
  std::vector<std::vector<cv::Point2f>> seen(6);
  for (int k = 0; k < cube.tracks.size(); ++k) {
    const Eigen::Vector3d& x = cube.truth.points[cube.tracks.point[k]];
    board[cube.tracks.image[k]].emplace_back(x.x(), x.y(), 0);
    seen[cube.tracks.image[k]].emplace_back(cube.tracks.pixel[k].x(), cube.tracks.pixel[k].y());
  }
  cv::Mat lens = (cv::Mat_<double>(3, 3) << 1, 0, 0, 0, 1, 0, 0, 0, 1), distortion, r, t;
  const double rms =
      cv::calibrateCamera(board, seen, cv::Size(501, 501), lens, distortion, r, t,
                          cv::CALIB_FIX_ASPECT_RATIO | cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_FIX_K3,
                          cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-12));
  EXPECT_NEAR(result->rms_px, rms, 1e-3);
  EXPECT_NEAR(result->scene.lenses[0].fx, lens.at<double>(0, 0), 0.5);
  EXPECT_NEAR(result->radial.k1, distortion.at<double>(0), 0.01);
}

TEST(KnownStructure, OneDepthTellsNoFocalLength) {
  Rng rng(4);
  Cube cube = make_board({.images = 4}, &rng);
  for (Rigid3& pose : cube.truth.cam_from_world) {
    pose = {exp_so3({0, 0, rng.uniform(-1, 1)}), {rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 5}};
  }
  test_scenes::project_all(cube.truth, &cube.tracks);
  test_scenes::add_noise(0.2, &rng, &cube.tracks);
  const auto result = reconstruct_known(cube.tracks, cube.truth.points, {});
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_EQ(result->degenerate, "known points at one depth");
}

// A handful of points, most of them somewhere else: there may be no solution, but a solution is one.
TEST(KnownStructure, FewAndMostlyWrongPointsEndInAnAnswer) {
  int solved = 0, refused = 0;
  for (const int points : {7, 12, 30, 120}) {
    for (int seed = 0; seed < 12; ++seed) {
      Rng rng(seed);
      Cube cube = test_scenes::make_cube({.images = 4, .points = points}, &rng);
      std::vector<Eigen::Vector3d> given = cube.truth.points;
      const double wrong = 0.5 + 0.05 * (seed % 10);
      for (Eigen::Vector3d& x : given) {
        if (rng.uniform() < wrong) x = {rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)};
      }
      for (const LensChange lens : {LensChange::kAuto, LensChange::kFixed, LensChange::kZoom}) {
        const auto result = reconstruct_known(cube.tracks, given, {.lens = lens, .max_samples = 200});
        ++(result.ok() ? solved : refused);
        if (!result.ok()) {
          EXPECT_EQ(result.error().kind, ErrorKind::kNoReconstruction);
          continue;
        }
        EXPECT_GT(std::ranges::count(result->image_posed, 1), 0);
        EXPECT_TRUE(std::isfinite(result->rms_px));
      }
    }
  }
  EXPECT_GT(solved, 0);
  EXPECT_GT(refused, 0);
}

TEST(KnownStructure, WhatCannotBeIsNamed) {
  Rng rng(5);
  Cube cube = make_board({.images = 3}, &rng);
  const auto failure = [&](const std::vector<Eigen::Vector3d>& points) {
    const auto result = reconstruct_known(cube.tracks, points, {});
    return result.ok() ? "" : result.error().message;
  };
  std::vector<Eigen::Vector3d> points = cube.truth.points;
  points.pop_back();
  EXPECT_EQ(failure(points), "known structure: 53 points, must be 54");
  points = cube.truth.points;
  points[3].y() = INFINITY;
  EXPECT_EQ(failure(points), "known structure: point 3 must be three finite numbers");
  for (Eigen::Vector3d& x : points) x = {x.x(), 2 * x.x(), 1};
  EXPECT_EQ(failure(points), "known structure: its points lie on a line");
  for (Eigen::Vector3d& x : points) x = {1, 2, 3};
  EXPECT_EQ(failure(points), "known structure: its points lie on a line");
  for (Eigen::Vector3d& x : points) x = {rng.normal(), rng.normal(), 0};
  EXPECT_EQ(failure(points), "known structure: no image agrees with it in 6 points");
}

}  // namespace
}  // namespace raysfm
