#include "raysfm/optim/robust_loss.h"

#include <gtest/gtest.h>

namespace raysfm {
namespace {

using Kind = RobustLoss::Kind;

TEST(RobustLoss, WeightIsTheDerivativeOfTheCost) {
  for (Kind kind : {Kind::kNone, Kind::kHuber, Kind::kCauchy, Kind::kTukey}) {
    const RobustLoss loss{kind, 1.7};
    for (double s : {0.01, 0.5, 2.0, 2.8, 3.0, 10.0, 1e4}) {
      const double h = 1e-5 * s;
      EXPECT_NEAR(loss.weight(s), (loss.cost(s + h) - loss.cost(s - h)) / (2 * h), 1e-7)
          << int(kind) << " " << s;
    }
  }
}

TEST(RobustLoss, IsLeastSquaresNearZero) {
  for (Kind kind : {Kind::kNone, Kind::kHuber, Kind::kCauchy, Kind::kTukey}) {
    const RobustLoss loss{kind, 2.0};
    EXPECT_EQ(loss.cost(0), 0);
    EXPECT_EQ(loss.weight(0), 1);
    EXPECT_NEAR(loss.cost(1e-6) / 1e-6, 1, 1e-6);
  }
}

TEST(RobustLoss, ValuesByHand) {
  EXPECT_DOUBLE_EQ((RobustLoss{Kind::kHuber, 2}.cost(9)), 2 * 2 * 3 - 4);
  EXPECT_DOUBLE_EQ((RobustLoss{Kind::kCauchy, 2}.cost(4)), 4 * std::log(2.0));
  EXPECT_DOUBLE_EQ((RobustLoss{Kind::kTukey, 3}.cost(100)), 3);
  EXPECT_EQ((RobustLoss{Kind::kTukey, 3}.weight(9)), 0);
}

}  // namespace
}  // namespace raysfm
