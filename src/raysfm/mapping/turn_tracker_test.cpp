#include "raysfm/mapping/turn_tracker.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "raysfm/geometry/rotation.h"
#include "support/panel_world.h"

namespace raysfm {
namespace {

using testing_support::film;
using testing_support::PanelWorld;
using testing_support::small_camera;

// At rig poses in the world of the panels, which are some metres ahead.
class TurnTrackerTest : public testing::Test {
 protected:
  ViewPtr view(const Rigid3& rig_from_world, int frame) const {
    return film(world_, rig_.camera(0), rig_from_world, frame);
  }
  void begin(const Rigid3& rig_from_world) {
    turner_.begin(view(rig_from_world, 0), {rig_from_world, 1e-8 * Matrix6d::Identity()}, 4, rule_);
  }

  PanelWorld world_{7};
  TrackingRig rig_{Rig{{small_camera()}}};
  TurnTracker turner_{rig_};
  TurnRule rule_;
};

Rigid3 turned(double angle) {
  return {exp_so3(Eigen::Vector3d(0.1, 1, 0.05).normalized() * angle), Eigen::Vector3d::Zero()};
}

TEST_F(TurnTrackerTest, TellsHowFarTheRigHasTurned) {
  const Rigid3 start{exp_so3({0.02, 0.15, 0.01}), {0.2, -0.1, 0.3}};
  begin(start);
  double errors = 0;
  constexpr int kViews = 12;
  for (int i = 1; i <= kViews; ++i) {
    const Rigid3 truth = turned(-0.03 * i) * start;
    const std::optional<TurnedPose> pose = turner_.advance(view(truth, i), 0);
    ASSERT_TRUE(pose) << i;
    EXPECT_LT((pose->rig_from_world.inverse().translation - start.inverse().translation).norm(), 1e-12);
    const Eigen::AngleAxisd off(truth.rotation * pose->rig_from_world.rotation.conjugate());
    EXPECT_LT(off.angle(), 1e-3);
    const Eigen::Vector3d w = off.angle() * off.axis();
    errors += w.dot(pose->covariance.bottomRightCorner<3, 3>().llt().solve(w)) / kViews;
    EXPECT_GT(pose->covariance(0, 0), 1e-4) << "a centimetre at 4 metres is not seen";
  }
  EXPECT_LT(errors, 3 * 3);
  EXPECT_GT(errors, 3 / 30.0);
}

TEST_F(TurnTrackerTest, AStepAsideIsNoTurn) {
  begin({});
  const auto aside = [](double metres) {
    return Rigid3{Eigen::Quaterniond::Identity(), {-metres, 0, 0}} * turned(-0.02);
  };
  EXPECT_FALSE(turner_.advance(view(aside(0.4), 1), 0));
  EXPECT_TRUE(turner_.advance(view(aside(0), 2), 0)) << "back again";
  EXPECT_TRUE(turner_.is_turning());
}

// A centimetre and a half aside with each view is seen from afar, but not from one view to the next.
TEST_F(TurnTrackerTest, WhatMovesSlowlyIsATurnFromViewToViewAtMost) {
  constexpr int kViews = 24;
  for (const bool from_view_to_view : {false, true}) {
    rule_ = {.explained = 0.85, .from_view_to_view = from_view_to_view};
    begin({});
    int posed = 0;
    for (int i = 1; i <= kViews; ++i) {
      const Rigid3 aside{Eigen::Quaterniond::Identity(), {-0.015 * i, 0, 0}};
      posed += turner_.advance(view(aside * turned(-0.005 * i), i), 0).has_value();
    }
    if (from_view_to_view) {
      EXPECT_EQ(posed, kViews);
    } else {
      EXPECT_LT(posed, kViews / 2);
    }
  }
}

TEST_F(TurnTrackerTest, EndsWhereNothingIsSeenForLong) {
  begin({});
  int frame = 0;
  while (turner_.is_turning() && frame < 100) {
    ++frame;
    EXPECT_FALSE(turner_.advance(testing_support::black_view(320, 240, frame), 0));
  }
  EXPECT_GT(frame, 5);
  EXPECT_LT(frame, 30);
  EXPECT_FALSE(turner_.advance(view({}, frame + 1), 0));
}

}  // namespace
}  // namespace raysfm
