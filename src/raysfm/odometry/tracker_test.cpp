#include "raysfm/odometry/tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::corridor;
using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

PixelView pixels_of(const GrayImage& image) {
  return {image.row(0), image.width(), image.height(), image.view().stride};
}

// Keeps all that it is told.
struct Listener : TrackerObserver {
  std::vector<FramePosed> posed;
  std::vector<WorldStarted> started;
  std::vector<KeyFrameAdded> keyframes;
  std::vector<MapAdjusted> adjusted;
  std::vector<TrackLost> lost;
  std::vector<TrackFound> found;
  void frame_posed(const FramePosed& e) override { posed.push_back(e); }
  void world_started(const WorldStarted& e) override { started.push_back(e); }
  void keyframe_added(const KeyFrameAdded& e) override { keyframes.push_back(e); }
  void map_adjusted(const MapAdjusted& e) override { adjusted.push_back(e); }
  void track_lost(const TrackLost& e) override { lost.push_back(e); }
  void track_found(const TrackFound& e) override { found.push_back(e); }
};

std::unique_ptr<Tracker> make_tracker(TrackerObserver* observer = nullptr) {
  auto tracker = Tracker::create(Rig{{small_camera()}}, {}, observer);
  EXPECT_TRUE(tracker) << tracker.error().message;
  return *std::move(tracker);
}

FrameResult push(Tracker& tracker, const GrayImage& image, double timestamp) {
  const PixelView pixels = pixels_of(image);
  const Result<FrameResult> frame = tracker.push({&pixels, 1}, timestamp);
  EXPECT_TRUE(frame) << frame.error().message;
  return frame ? *frame : FrameResult{};
}

bool same_bits(const Rigid3& a, const Rigid3& b) {
  return std::memcmp(a.rotation.coeffs().data(), b.rotation.coeffs().data(), 4 * sizeof(double)) == 0 &&
         std::memcmp(a.translation.data(), b.translation.data(), 3 * sizeof(double)) == 0;
}

// The same poses and points.
void expect_same(const Reconstruction& a, const Reconstruction& b) {
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (size_t i = 0; i < a.frames.size(); ++i) {
    ASSERT_EQ(a.frames[i].world_from_rig.has_value(), b.frames[i].world_from_rig.has_value()) << i;
    EXPECT_EQ(a.frames[i].reason, b.frames[i].reason) << i;
    if (!a.frames[i].world_from_rig) continue;
    EXPECT_TRUE(same_bits(*a.frames[i].world_from_rig, *b.frames[i].world_from_rig)) << i;
    EXPECT_EQ(a.frames[i].covariance, b.frames[i].covariance) << i;
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (size_t i = 0; i < a.points.size(); ++i) EXPECT_EQ(a.points[i].position, b.points[i].position) << i;
  EXPECT_EQ(a.observations.size(), b.observations.size());
  EXPECT_EQ(a.keyframes.size(), b.keyframes.size());
}

TEST(Tracker, GivesTheSameAsViewsThatAreMadeByHand) {
  OdometryOptions options;
  options.features = 600;  // as in as_view()
  Odometry odometry(Rig{{small_camera()}}, options);
  const auto tracker = Tracker::create(Rig{{small_camera()}}, {options, {}});
  ASSERT_TRUE(tracker);
  for (int i = 0; i < corridor().size(); ++i) {
    const ViewPtr view = corridor().view(i, i);
    odometry.process(view);
    push(**tracker, corridor().images[i], view->timestamp);
  }
  EXPECT_EQ((*tracker)->frames(), corridor().size());
  EXPECT_EQ((*tracker)->posed(), corridor().size());
  expect_same(odometry.finish(false), (*tracker)->finish(false));
}

TEST(Tracker, TellsThePoseOfAFrameAtOnce) {
  const std::unique_ptr<Tracker> tracker = make_tracker();
  int posed_at_once = 0;
  for (int i = 0; i < corridor().size(); ++i) {
    const FrameResult frame = push(*tracker, corridor().images[i], i);
    EXPECT_EQ(frame.frame, i);
    EXPECT_EQ(frame.state == TrackingState::kTracking, frame.pose.has_value());
    EXPECT_EQ(frame.pose.has_value(), frame.reason.empty());
    if (!frame.pose) {
      EXPECT_EQ(frame.state, TrackingState::kStarting);
      continue;
    }
    ++posed_at_once;
    const Reconstruction now = tracker->snapshot();
    ASSERT_TRUE(now.frames[i].world_from_rig);
    EXPECT_TRUE(same_bits(*now.frames[i].world_from_rig, frame.pose->world_from_rig)) << i;
    EXPECT_EQ(now.frames[i].covariance, frame.pose->covariance) << i;
  }
  EXPECT_GT(posed_at_once, corridor().size() / 3);
}

TEST(Tracker, ASnapshotChangesNothing) {
  const std::unique_ptr<Tracker> watched = make_tracker(), alone = make_tracker();
  for (int i = 0; i < corridor().size(); ++i) {
    push(*watched, corridor().images[i], i);
    push(*alone, corridor().images[i], i);
    const Reconstruction now = watched->snapshot();
    EXPECT_EQ(static_cast<int>(now.frames.size()), i + 1);
    EXPECT_EQ(now.rms_reprojection_px > 0, !now.observations.empty());
  }
  const Reconstruction last = watched->snapshot();
  EXPECT_GT(last.points.size(), 100u);
  expect_same(watched->finish(false), alone->finish(false));
}

TEST(Tracker, TheObserverHearsOfEveryFrameAndKeyFrame) {
  Listener heard;
  const std::unique_ptr<Tracker> tracker = make_tracker(&heard);
  for (int i = 0; i < corridor().size(); ++i) push(*tracker, corridor().images[i], i);
  const Reconstruction r = tracker->finish(false);
  ASSERT_EQ(heard.started.size(), 1u);
  EXPECT_EQ(heard.started[0].start.frames, r.starts[0].frames);
  std::vector<int> frames, keyframes;
  for (const FramePosed& e : heard.posed) frames.push_back(e.frame);
  std::ranges::sort(frames);
  ASSERT_EQ(frames.size(), r.frames.size()) << "each once";
  for (int i = 0; i < static_cast<int>(frames.size()); ++i) EXPECT_EQ(frames[i], i);
  for (size_t k = 0; k < heard.keyframes.size(); ++k) {
    EXPECT_EQ(heard.keyframes[k].keyframe, static_cast<int>(k));
    EXPECT_EQ(heard.keyframes[k].frame, r.keyframes[k].frame);
  }
  EXPECT_EQ(heard.keyframes.size(), r.keyframes.size());
  EXPECT_EQ(heard.adjusted.size() + 3, r.keyframes.size()) << "one for each key frame after the start";
  EXPECT_TRUE(heard.lost.empty());
}

// Frames that may not move do not; and they do become such.
TEST(Tracker, SaysWhichPosesMayStillMove) {
  const SynthViews film = synth_views("corridor", "drive", 90);
  OdometryOptions options;
  options.global_until = 6;
  auto tracker = Tracker::create(Rig{{small_camera()}}, {options, {}});
  ASSERT_TRUE(tracker);
  std::vector<Rigid3> fixed;
  const auto expect_fixed = [&](const Reconstruction& now) {
    for (size_t i = 0; i < fixed.size(); ++i) {
      ASSERT_TRUE(now.frames[i].world_from_rig);
      EXPECT_TRUE(same_bits(*now.frames[i].world_from_rig, fixed[i])) << i;
    }
  };
  for (int i = 0; i < film.size(); ++i) {
    push(**tracker, film.images[i], i);
    if (i % 10 != 9) continue;
    const Reconstruction now = (*tracker)->snapshot();
    expect_fixed(now);
    for (int f = static_cast<int>(fixed.size()); f < (*tracker)->first_movable_frame(); ++f) {
      ASSERT_TRUE(now.frames[f].world_from_rig) << f;
      fixed.push_back(*now.frames[f].world_from_rig);
    }
  }
  EXPECT_GT(fixed.size(), 10u);
  EXPECT_LT(static_cast<int>(fixed.size()), film.size());
  expect_fixed((*tracker)->finish(false));
}

TEST(Tracker, LossIsToldWithItsReason) {
  Listener heard;
  const std::unique_ptr<Tracker> tracker = make_tracker(&heard);
  GrayImage black(small_camera().width, small_camera().height);
  for (int y = 0; y < black.height(); ++y) std::memset(black.row(y), 0, black.width());
  for (int i = 0; i < 20; ++i) push(*tracker, corridor().images[i], i);
  const FrameResult blind = push(*tracker, black, 20);
  EXPECT_EQ(blind.state, TrackingState::kLost);
  EXPECT_FALSE(blind.pose);
  EXPECT_NE(blind.reason.find("nearly black"), std::string::npos) << blind.reason;
  ASSERT_EQ(heard.lost.size(), 1u);
  EXPECT_EQ(heard.lost[0].frame, 20);
  const FrameResult again = push(*tracker, corridor().images[20], 21);
  EXPECT_EQ(again.state, TrackingState::kTracking) << again.reason;
  ASSERT_EQ(heard.found.size(), 1u);
  EXPECT_EQ(heard.found[0].frame, 21);
}

TEST(Tracker, AnImageThatDidNotArriveIsAFrameWithoutAPose) {
  const std::unique_ptr<Tracker> tracker = make_tracker();
  for (int i = 0; i < corridor().size(); ++i) {
    if (i != 22) {
      push(*tracker, corridor().images[i], i);
      continue;
    }
    const PixelView none;
    const Result<FrameResult> frame = tracker->push({&none, 1}, i);
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_FALSE(frame->pose);
    EXPECT_EQ(frame->reason, "no image of stream 0");
  }
  EXPECT_EQ(tracker->frames(), corridor().size());
  EXPECT_EQ(tracker->posed(), corridor().size() - 1) << "it is no loss of track";
}

TEST(Tracker, WhatCannotBeRightIsRefusedAndDoesNotCount) {
  const std::unique_ptr<Tracker> tracker = make_tracker();
  const GrayImage &image = corridor().images[0], small(32, 32);
  push(*tracker, image, 5);
  const auto refused = [&](std::vector<PixelView> images, double timestamp, const char* word) {
    const Result<FrameResult> frame = tracker->push(images, timestamp);
    ASSERT_FALSE(frame);
    EXPECT_EQ(frame.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(frame.error().message.find(word), std::string::npos) << frame.error().message;
  };
  refused({pixels_of(image)}, 5, "timestamp: 5");
  refused({pixels_of(image)}, std::numeric_limits<double>::quiet_NaN(), "timestamp: nan");
  refused({pixels_of(image), pixels_of(image)}, 6, "images: 2 given");
  refused({pixels_of(small)}, 6, "32 x 32");
  EXPECT_EQ(tracker->frames(), 1);
  EXPECT_EQ(push(*tracker, image, 6).frame, 1);
}

TEST(Tracker, OptionsAreChecked) {
  const auto message = [](Rig rig, TrackerOptions options) {
    const auto tracker = Tracker::create(std::move(rig), std::move(options));
    return tracker ? std::string() : tracker.error().message;
  };
  EXPECT_NE(message({}, {}).find("no cameras"), std::string::npos);
  EXPECT_NE(message(Rig{std::vector(257, small_camera())}, {}).find("257 cameras; 256 at most"),
            std::string::npos);
  TrackerOptions few;
  few.odometry.features = 3;
  EXPECT_NE(message(Rig{{small_camera()}}, std::move(few)).find("features"), std::string::npos);
  TrackerOptions masked;
  masked.masks.emplace_back(8, 8);
  EXPECT_NE(message(Rig{{small_camera()}}, std::move(masked)).find("masks[0]: 8 x 8"), std::string::npos);
}

}  // namespace
}  // namespace raysfm
