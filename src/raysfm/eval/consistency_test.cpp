// Errors drawn from known covariances must lie within their ellipsoids as often as these say.
#include "raysfm/eval/consistency.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <array>
#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

constexpr std::array kLengths = {10, 40};

// An estimate in another world, whose errors are drawn from covariances that differ from frame to frame.
struct Drawn {
  Trajectory truth, estimate;
  std::vector<Matrix6d> covariances;

  explicit Drawn(int count, double understated = 1) {
    Rng rng(3);
    const Similarity3 other{0.2, exp_so3({2, 1, -0.5}), {1, 2, 3}};
    for (int i = 0; i < count; ++i) {
      const double angle = 0.02 * i;
      const Rigid3 pose{exp_so3({0.1 * std::sin(angle), angle, 0}),
                        {50 * std::cos(angle), 2 * std::sin(3 * angle), 50 * std::sin(angle)}};
      Matrix6d root = Matrix6d::Zero();
      for (int r = 0; r < 6; ++r) {
        for (int c = 0; c <= r; ++c) root(r, c) = (r < 3 ? 4e-4 : 1e-4) * rng.normal();
        root(r, r) = (r < 3 ? 2e-3 : 5e-4) * (1 + 0.2 * (i % 3));
      }
      Eigen::Vector<double, 6> draw;
      for (int k = 0; k < 6; ++k) draw[k] = rng.normal();
      draw = (root * draw).eval();
      Rigid3 seen = transform_pose(other, pose);
      seen.rotation = exp_so3(draw.tail<3>()) * seen.rotation;
      seen.translation += draw.head<3>();
      truth.timestamps.push_back(i);
      truth.world_from_cam.push_back(pose);
      estimate.timestamps.push_back(i);
      estimate.world_from_cam.push_back(seen);
      covariances.push_back(root * root.transpose() / (understated * understated));
    }
  }

  std::vector<WindowConsistency> judged(Alignment alignment = Alignment::kSim3) const {
    auto result = window_consistency(estimate, covariances, truth, {alignment, 0.01}, kLengths);
    if (!result) ADD_FAILURE() << result.error().message;
    return result ? *result : std::vector<WindowConsistency>(kLengths.size());
  }
};

TEST(WindowConsistency, KnownCovariancesHoldAsOftenAsTheySay) {
  const auto windows = Drawn(8000).judged();
  ASSERT_EQ(windows.size(), 2u);
  EXPECT_EQ(windows[0].windows, 800);
  EXPECT_EQ(windows[1].frames, 8000);
  // The alignment takes up seven of 120 numbers, three for orientations; 8000 draws scatter by 0.0034.
  EXPECT_NEAR(windows[1].position.held, 0.905, 0.012);
  EXPECT_NEAR(windows[1].orientation.held, 0.905, 0.012);
  EXPECT_NEAR(windows[1].position.normalised_error2, 1, 0.04);
  EXPECT_NEAR(windows[1].orientation.normalised_error2, 1, 0.03);
  // Of ten frames it fits a quarter of their error.
  EXPECT_GT(windows[0].position.held, windows[1].position.held);
  EXPECT_NEAR(windows[0].orientation.normalised_error2, 1, 0.05);
}

TEST(WindowConsistency, CovariancesThatAreTooSmallDoNotHold) {
  const auto windows = Drawn(4000, 2.0).judged();
  // P(chi2_3 <= 6.25 / 4) = 0.332.
  EXPECT_NEAR(windows[1].position.held, 0.34, 0.04);
  EXPECT_NEAR(windows[1].orientation.held, 0.34, 0.03);
  EXPECT_NEAR(windows[1].position.normalised_error2, 4, 0.25);
}

// Errors that all frames of a window share are none.
TEST(WindowConsistency, TheWorldOfTheEstimateDoesNotMatter) {
  Drawn drawn(200);
  for (size_t i = 0; i < drawn.covariances.size(); ++i) {
    drawn.estimate.world_from_cam[i] =
        transform_pose({5, exp_so3({1, 2, 0}), {4, 0, 1}}, drawn.truth.world_from_cam[i]);
  }
  for (const WindowConsistency& w : drawn.judged()) {
    EXPECT_EQ(w.position.held, 1);
    EXPECT_EQ(w.orientation.held, 1);
    EXPECT_LT(w.position.normalised_error2, 1e-9);
  }
  // A rigid alignment sees the other scale.
  EXPECT_LT(drawn.judged(Alignment::kSe3)[1].position.held, 0.2);
  EXPECT_EQ(drawn.judged(Alignment::kNone)[0].orientation.held, 0);
}

TEST(WindowConsistency, AFrameWithoutACovarianceIsNotHeld) {
  Drawn drawn(40);
  for (int i = 0; i < 20; ++i) drawn.covariances[2 * i].setZero();
  const auto windows = drawn.judged();
  EXPECT_LE(windows[1].position.held, 0.5);
  EXPECT_GT(windows[1].position.held, 0.3);
  EXPECT_LT(windows[1].position.normalised_error2, 3);
}

TEST(WindowConsistency, TooFewFramesMakeNoWindow) {
  const auto windows = Drawn(39).judged();
  EXPECT_EQ(windows[0].windows, 3);
  EXPECT_EQ(windows[1].windows, 0);
  EXPECT_EQ(windows[1].position.held, 0);
}

TEST(WindowConsistency, ContradictionsAreRefused) {
  Drawn drawn(50);
  constexpr std::array kTooShort = {3};
  EXPECT_FALSE(window_consistency(drawn.estimate, drawn.covariances, drawn.truth, {}, kTooShort));
  drawn.covariances.pop_back();
  const auto refused = window_consistency(drawn.estimate, drawn.covariances, drawn.truth, {}, kLengths);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message, "49 covariances for 50 poses of the estimate");
}

}  // namespace
}  // namespace raysfm
