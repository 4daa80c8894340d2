#include "raysfm/plots/plot.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>

#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::TemporaryFolder;

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
  int orange = 0;
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) orange += picture.at<cv::Vec3b>(y, x) == cv::Vec3b(30, 110, 235);
  }
  return orange > 20;
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

TEST(Plot, UnwritablePathIsAnError) {
  const Trajectory truth = path(10, 20, {1, 0, 0});
  const Result<Evaluation> evaluation = evaluate(truth, truth, {});
  ASSERT_TRUE(evaluation.ok());
  EXPECT_FALSE(plot_evaluation(truth, truth, *evaluation, "/no/such/folder/plot.png").ok());
}

}  // namespace
}  // namespace raysfm
