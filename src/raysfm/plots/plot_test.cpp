#include "raysfm/plots/plot.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::TemporaryFolder;

// Where the colour of the estimate is.
std::vector<Eigen::Vector2d> orange_pixels(const cv::Mat& picture) {
  std::vector<Eigen::Vector2d> pixels;
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      if (picture.at<cv::Vec3b>(y, x) == cv::Vec3b(30, 110, 235)) pixels.emplace_back(x, y);
    }
  }
  return pixels;
}

// Draws `truth` and itself scaled by two; true where the file is a picture with some of the estimate's
// colour.
bool draws(const Trajectory& truth) {
  const TemporaryFolder folder;
  Trajectory estimate = truth;
  for (Rigid3& pose : estimate.world_from_cam) pose.translation *= 2;
  const Result<Evaluation> evaluation = evaluate(estimate, truth, {});
  if (!evaluation) return false;
  const auto path = folder.path() / "plot.png";
  if (!plot_evaluation(estimate, truth, *evaluation, path)) return false;
  const cv::Mat picture = cv::imread(path.string());
  return orange_pixels(picture).size() > 20;
}

Trajectory path(double metres, int count, Eigen::Vector3d direction) {
  Trajectory trajectory;
  for (int i = 0; i < count; ++i) {
    trajectory.timestamps.push_back(i);
    trajectory.world_from_cam.push_back(
        {Eigen::Quaterniond::Identity(),
         metres * i / count * direction + Eigen::Vector3d(0, 0, std::sin(0.1 * i))});
  }
  return trajectory;
}

TEST(Plot, DrawsPathsOfAnySize) {
  for (const double metres : {1e-6, 0.3, 70.0, 1e9})
    EXPECT_TRUE(draws(path(metres, 100, {1, 2, 0}))) << metres;
}

TEST(Plot, DrawsWhatHardlyMoves) {
  Trajectory still = path(1, 10, {1, 0, 0});
  for (Rigid3& pose : still.world_from_cam) pose.translation = {5, 6, 7};
  EXPECT_TRUE(draws(still));
  for (int i = 0; i < 10; ++i) still.world_from_cam[i].translation = {1e12, 1e12, i * 1e-3};
  EXPECT_TRUE(draws(still));
}

// Seen from above a circle is one: closed, and round because both axes have one scale.
TEST(Plot, ACircleIsDrawnAsOne) {
  constexpr int kPoses = 200, kErrorDiagram = 340, kLegendLeft = 940, kLegendBottom = 220, kSectors = 72;
  constexpr double kTurn = 2 * std::numbers::pi;
  Trajectory truth = path(1, kPoses, {0, 0, 0});
  for (int i = 0; i < kPoses; ++i) {
    const double angle = kTurn * i / (kPoses - 1);
    truth.world_from_cam[i].translation = {30 * std::cos(angle), 30 * std::sin(angle), 0};
  }
  Trajectory estimate = truth;
  for (Rigid3& pose : estimate.world_from_cam) pose.translation *= 2;
  const TemporaryFolder folder;
  const Result<Evaluation> evaluation = evaluate(estimate, truth, {});
  ASSERT_TRUE(evaluation);
  ASSERT_TRUE(plot_evaluation(estimate, truth, *evaluation, folder.path() / "plot.png"));
  const cv::Mat picture = cv::imread((folder.path() / "plot.png").string());
  std::vector<Eigen::Vector2d> circle = orange_pixels(picture);
  std::erase_if(circle, [&](const Eigen::Vector2d& p) {
    return p.y() > picture.rows - kErrorDiagram || (p.x() > kLegendLeft && p.y() < kLegendBottom);
  });
  ASSERT_GT(circle.size(), 1000u);
  Eigen::Vector2d low = circle[0], high = circle[0];
  for (const Eigen::Vector2d& p : circle) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const Eigen::Vector2d centre = (low + high) / 2;
  const double radius = (high - low).x() / 2;
  EXPECT_NEAR((high - low).y() / 2, radius, 3);
  std::vector<int> sectors(kSectors, 0);
  for (const Eigen::Vector2d& p : circle) {
    const Eigen::Vector2d d = p - centre;
    EXPECT_NEAR(d.norm(), radius, 6);
    ++sectors[static_cast<int>((std::atan2(d.y(), d.x()) / kTurn + 0.5) * (kSectors - 1e-9))];
  }
  EXPECT_GT(*std::ranges::min_element(sectors), 0);
}

TEST(Plot, UnwritablePathIsAnError) {
  const Trajectory truth = path(10, 20, {1, 0, 0});
  const Result<Evaluation> evaluation = evaluate(truth, truth, {});
  ASSERT_TRUE(evaluation.ok());
  EXPECT_FALSE(plot_evaluation(truth, truth, *evaluation, "/no/such/folder/plot.png").ok());
}

}  // namespace
}  // namespace raysfm
