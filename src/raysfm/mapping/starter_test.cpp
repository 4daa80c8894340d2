#include "raysfm/mapping/starter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>

#include "raysfm/odometry/odometry.h"
#include "support/panel_world.h"

namespace raysfm {
namespace {

using testing_support::black_view;
using testing_support::degrees_between;
using testing_support::film;
using testing_support::PanelWorld;
using testing_support::small_camera;
using testing_support::world_ray;

// To the right and a little forward, turning slowly.
Rigid3 moving(int frame) {
  const double t = frame;
  const Rigid3 world_from_rig{exp_so3({0.001 * t, -0.002 * t, 0.0015 * t}),
                              {-0.4 + 0.04 * t, 0.004 * t, 0.008 * t}};
  return world_from_rig.inverse();
}

constexpr uint64_t kWorld = 7;

// What the moving camera sees, filmed once for all tests.
ViewPtr moving_view(int frame) {
  static std::map<int, ViewPtr> filmed;
  ViewPtr& view = filmed[frame];
  if (!view) view = film(PanelWorld(kWorld), small_camera(), moving(frame), frame);
  return view;
}

class StarterTest : public testing::Test {
 protected:
  void feed_moving() {
    for (int i = 0; i < 25 && !start_; ++i) start_ = starter_.push(moving_view(i), mapper_);
    if (!start_) start_ = starter_.finish(mapper_);
  }
  // Feeds frames until there is a start.
  void feed(int frames, const std::function<ViewPtr(int)>& view_of) {
    for (int i = 0; i < frames && !start_; ++i) start_ = starter_.push(view_of(i), mapper_);
    if (!start_) start_ = starter_.finish(mapper_);
  }
  ViewPtr see(const Rigid3& rig_from_world, int frame) const {
    return film(world_, rig_.camera(0), rig_from_world, frame);
  }

  PanelWorld world_{kWorld};
  TrackingRig rig_{Rig{{small_camera()}}};
  OdometryOptions options_;
  Mapper mapper_{rig_, options_};
  Starter starter_{rig_, options_};
  std::optional<Start> start_;
};

TEST_F(StarterTest, FindsTheMotionOfThreeViews) {
  feed_moving();
  ASSERT_TRUE(start_) << starter_.reason();
  ASSERT_EQ(start_->map.keyframes.size(), 3u);
  ASSERT_EQ(start_->views.size(), 3u);
  const MapKeyFrame* keyframes = start_->map.keyframes.data();
  EXPECT_EQ(start_->summary.frames,
            (std::vector<int>{keyframes[0].frame, keyframes[1].frame, keyframes[2].frame}));
  EXPECT_LT(keyframes[0].frame, keyframes[1].frame);
  EXPECT_LT(keyframes[1].frame, keyframes[2].frame);
  EXPECT_EQ(starter_.views()[start_->first_view].frame, keyframes[0].frame);
  // The first key frame is the world.
  EXPECT_LT(keyframes[0].rig_from_world.translation.norm(), 1e-12);
  EXPECT_LT(degrees_between(keyframes[0].rig_from_world.rotation, Eigen::Quaterniond::Identity()), 1e-6);

  const Rigid3 world_from_first = moving(keyframes[0].frame).inverse();
  Eigen::Vector3d truth[3], found[3];
  for (int v = 1; v < 3; ++v) {
    const Rigid3 true_rig_from_first = moving(keyframes[v].frame) * world_from_first;
    EXPECT_LT(degrees_between(keyframes[v].rig_from_world.rotation, true_rig_from_first.rotation), 0.3) << v;
    truth[v] = true_rig_from_first.inverse().translation;
    found[v] = keyframes[v].rig_from_world.inverse().translation;
    EXPECT_LT(degrees_between(found[v], truth[v]), 2.0) << v;
  }
  EXPECT_NEAR(found[1].norm() / found[2].norm(), truth[1].norm() / truth[2].norm(), 0.02);
}

TEST_F(StarterTest, PointsLieOnTheSurfacesInTheScaleOfTheStart) {
  feed_moving();
  ASSERT_TRUE(start_) << starter_.reason();
  const MapKeyFrame* keyframes = start_->map.keyframes.data();
  const double metres =
      (moving(keyframes[2].frame) * moving(keyframes[0].frame).inverse()).translation.norm() /
      keyframes[2].rig_from_world.translation.norm();
  int points = 0, right = 0;
  for (const Track& track : start_->map.tracks) {
    if (!track.triangulated) continue;
    ++points;
    const TrackObservation& o = track.observations[0];
    const Eigen::Vector2d pixel = keyframes[o.keyframe].pixels[o.feature].cast<double>();
    const Rigid3 true_pose = moving(keyframes[o.keyframe].frame);
    const auto truth = world_.hit(world_ray(rig_.camera(0), true_pose, pixel));
    ASSERT_TRUE(truth);
    const double distance = (true_pose * *truth).norm();
    right += std::abs(metres * (keyframes[o.keyframe].rig_from_world * track.position).norm() - distance) <
             0.1 * distance;
  }
  EXPECT_GT(points, 100);
  EXPECT_GT(right, 0.9 * points);
  EXPECT_EQ(start_->summary.method, "five-point");
  EXPECT_GT(start_->summary.inliers, 50);
  EXPECT_LE(start_->summary.inliers, points);
}

TEST_F(StarterTest, TellsWhatTheViewsBetweenSaw) {
  feed_moving();
  ASSERT_TRUE(start_) << starter_.reason();
  const MapKeyFrame* keyframes = start_->map.keyframes.data();
  const int between = keyframes[2].frame - keyframes[0].frame;
  ASSERT_GE(static_cast<int>(start_->seen.size()), between);
  for (int k = 0; k < between; ++k) {
    const Rigid3 pose = moving(keyframes[0].frame + 1 + k);
    int right = 0;
    for (const TrackPixel& seen : start_->seen[k]) {
      // Truth of the track by its first pixel; corners are up to about a pixel off.
      const TrackObservation& o = start_->map.tracks[seen.track].observations[0];
      const Eigen::Vector2d pixel = keyframes[o.keyframe].pixels[o.feature].cast<double>();
      const auto point = world_.hit(world_ray(rig_.camera(0), moving(keyframes[o.keyframe].frame), pixel));
      Eigen::Vector2d expected;
      right += point && rig_.camera(0).project(pose * *point, &expected) &&
               (expected - seen.pixel.cast<double>()).norm() < 2.5;
    }
    EXPECT_GT(start_->seen[k].size(), 50u) << k;
    EXPECT_GT(right, 0.8 * start_->seen[k].size()) << k;
  }
}

TEST_F(StarterTest, AStandingCameraDoesNotStart) {
  feed(8, [this](int i) { return see(moving(5), i); });
  EXPECT_FALSE(start_);
  EXPECT_NE(starter_.reason().find("no motion"), std::string::npos) << starter_.reason();
}

TEST_F(StarterTest, ATurningCameraDoesNotStart) {
  const Eigen::Vector3d place(-0.2, 0.1, 0.3);
  feed(24, [&](int i) {
    return see(Rigid3{exp_so3({0.002 * i, -0.3 + 0.025 * i, 0.003 * i}), place}.inverse(), i);
  });
  EXPECT_FALSE(start_);
  EXPECT_NE(starter_.reason().find("rotation"), std::string::npos) << starter_.reason();
  EXPECT_GT(starter_.attempts(), 0);
}

TEST_F(StarterTest, BlackFramesDoNotStart) {
  feed(6, [](int i) { return black_view(320, 240, i); });
  EXPECT_FALSE(start_);
  EXPECT_NE(starter_.reason().find("few"), std::string::npos) << starter_.reason();
}

TEST_F(StarterTest, FewerThanThreeFramesAreTooFew) {
  EXPECT_FALSE(starter_.finish(mapper_));
  EXPECT_NE(starter_.reason().find("0 frames are too few"), std::string::npos) << starter_.reason();

  Starter two(rig_, options_);
  EXPECT_FALSE(two.push(moving_view(0), mapper_));
  EXPECT_FALSE(two.push(moving_view(1), mapper_));
  EXPECT_FALSE(two.finish(mapper_));
  EXPECT_NE(two.reason().find("2 frames are too few"), std::string::npos) << two.reason();
}

TEST_F(StarterTest, StartsAfterABlackBeginningAndAStandingOne) {
  const auto pose_of = [](int i) { return moving(std::max(0, i - 5)); };
  feed(30, [&](int i) { return i < 3 ? black_view(320, 240, i) : see(pose_of(i), i); });
  ASSERT_TRUE(start_) << starter_.reason();
  const std::vector<MapKeyFrame>& keyframes = start_->map.keyframes;
  const Rigid3 truth = pose_of(keyframes[2].frame) * pose_of(keyframes[0].frame).inverse();
  EXPECT_LT(degrees_between(keyframes[2].rig_from_world.rotation, truth.rotation), 0.3);
  EXPECT_LT(degrees_between(keyframes[2].rig_from_world.inverse().translation, truth.inverse().translation),
            2.0);
}

// Looks about for long, and then moves.
Rigid3 lingering(int frame) {
  constexpr int kLooks = 70;
  const double turned = 0.01 * std::min(frame, kLooks), moved = 0.04 * std::max(0, frame - kLooks);
  return Rigid3{exp_so3({0, turned - 0.6, 0}), {moved - 0.4, 0, 0.2 * moved}}.inverse();
}

// More views wait than there is memory for: those that are let go of keep coarser images, and are posed.
TEST(StarterMemory, ViewsThatWaitedForLongArePosed) {
  constexpr int kFrames = 90;
  const PanelWorld world(kWorld);
  OdometryOptions options;
  options.waiting_bytes = size_t{3} << 20;
  Odometry odometry(Rig{{small_camera()}}, options, {});
  size_t bytes = 0;
  for (int i = 0; i < kFrames; ++i) {
    const ViewPtr view = film(world, small_camera(), lingering(i), i);
    bytes += bytes_of(*view);
    odometry.process(view);
  }
  ASSERT_GT(bytes, 3 * options.waiting_bytes);
  const Reconstruction r = odometry.finish(false);
  ASSERT_EQ(r.segments.size(), 1u);
  const int first = r.starts[0].frames[0];
  constexpr int kInSight = 25;  // frames before the first, which see much of what it sees
  ASSERT_GT(first, kInSight);
  const auto from_first = [&](const Rigid3& rig_from_world, const Rigid3& first_from_world) {
    return (rig_from_world * first_from_world.inverse()).rotation;
  };
  ASSERT_TRUE(r.frames[first].world_from_rig);
  const Rigid3 found_first = r.frames[first].world_from_rig->inverse();
  for (int i = first - kInSight; i < kFrames; ++i) {
    ASSERT_TRUE(r.frames[i].world_from_rig) << i << ": " << r.frames[i].reason;
    const Eigen::Quaterniond found = from_first(r.frames[i].world_from_rig->inverse(), found_first);
    EXPECT_LT(degrees_between(found, from_first(lingering(i), lingering(first))), 0.2) << i;
  }
}

// Turns while it moves a little, and then moves only.
Rigid3 turning_first(int frame) {
  constexpr int kTurns = 30;
  const double turned = 0.03 * std::min(frame, kTurns), moved = 0.04 * std::max(0, frame - kTurns);
  const double before = 0.012 * std::min(frame, kTurns);
  return Rigid3{exp_so3({0, turned - 0.6, 0}), {before + moved - 0.6, 0, 0.2 * moved}}.inverse();
}

struct HeardOfMaps : TrackerObserver {
  std::vector<MapAdjusted> adjusted;
  void map_adjusted(const MapAdjusted& e) override { adjusted.push_back(e); }
};

// Views before those that a start is made of become key frames as well, of the same world, which is told.
TEST(StarterViews, ThoseBeforeAStartBecomeKeyFrames) {
  constexpr int kFrames = 60;
  const PanelWorld world(kWorld);
  const OdometryOptions options;
  HeardOfMaps heard;
  Odometry odometry(Rig{{small_camera()}}, options, &heard);
  for (int i = 0; i < kFrames; ++i) odometry.process(film(world, small_camera(), turning_first(i), i));
  const Reconstruction r = odometry.finish(false);
  ASSERT_EQ(r.segments.size(), 1u);
  const int first = r.starts[0].frames[0];
  ASSERT_GT(first, 10);
  ASSERT_GT(r.keyframes.size(), 4u);
  EXPECT_LT(r.keyframes[1].frame, first);
  for (size_t k = 1; k < r.keyframes.size(); ++k) EXPECT_LT(r.keyframes[k - 1].frame, r.keyframes[k].frame);
  ASSERT_FALSE(heard.adjusted.empty());
  EXPECT_EQ(heard.adjusted[0].first_frame, 0);
  EXPECT_EQ(heard.adjusted[0].last_frame, r.starts[0].frames[2]);
  const auto place = [&](int frame) { return r.frames[frame].world_from_rig->translation; };
  EXPECT_LT(place(r.keyframes[0].frame).norm(), 1e-12);  // it is the world now
  const auto moved = [&](int from, int to) { return (place(to) - place(from)).norm(); };
  const auto truly = [&](int from, int to) {
    return (turning_first(to).inverse().translation - turning_first(from).inverse().translation).norm();
  };
  const int before = r.keyframes[0].frame, after = first + 20;
  EXPECT_NEAR(moved(before, first) / moved(first, after), truly(before, first) / truly(first, after), 0.01);
}

}  // namespace
}  // namespace raysfm
