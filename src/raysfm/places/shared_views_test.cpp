#include "raysfm/places/shared_views.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/places/meeting.h"
#include "support/described_map.h"

namespace raysfm {
namespace {

using testing_support::degrees_between;
using testing_support::small_camera;

// A camera that moves sideways past points of its own world, of which the first half have been seen long
// enough to have a position. Another world has all of them, in its own unit.
class SharedViewsTest : public testing::Test {
 protected:
  static constexpr int kPoints = 160, kKeyFrames = 6;

  SharedViewsTest() : rig_({{small_camera(2)}}) {
    Rng rng(5);
    for (int p = 0; p < kPoints; ++p) {
      points_.push_back({rng.uniform(-4, 4), rng.uniform(-3, 3), rng.uniform(5, 12)});
      const int track = there_.new_track();
      there_.tracks[track] = {.position = there_from_here_ * points_[p], .triangulated = true};
    }
    for (int p = 0; p < kPoints / 2; ++p) {
      here_.tracks[here_.new_track()] = {.position = points_[p], .triangulated = true};
    }
    for (int k = 0; k < kKeyFrames; ++k) add_keyframe(k, &rng);
  }

  void add_keyframe(int number, Rng* rng) {
    MapKeyFrame& k = here_.keyframes.emplace_back();
    k.frame = number;
    k.rig_from_world = {exp_so3({0, 0.02 * number, 0}), {-0.3 * number, 0, 0}};
    SharedView shared{number, carried_over(k.rig_from_world, there_from_here_), {}, {}};
    for (int p = 0; p < kPoints; ++p) {
      Eigen::Vector2d pixel;
      if (!rig_.see(0, k.rig_from_world * points_[p], &pixel)) continue;
      const Eigen::Vector2d noise(0.3 * rng->normal(), 0.3 * rng->normal());
      const Eigen::Vector2f seen = (pixel + noise).cast<float>();
      if (p < kPoints / 2) here_.observe(p, number, k.add(0, seen, 0, p));
      shared.matches.push_back({p, 0, 0, seen});
      shared.instant_pixels.push_back(seen);
    }
    if (number >= kKeyFrames / 2) shared_.push_back(std::move(shared));
  }

  std::optional<SharedPoints> relate(bool same_scale = false) const {
    return relate_by_views(rig_, here_, there_, shared_, same_scale);
  }

  void expect_right(const SharedPoints& found) const {
    const Similarity3& relation = found.relation.there_from_here;
    EXPECT_NEAR(relation.scale / there_from_here_.scale, 1, 0.01);
    EXPECT_LT(degrees_between(relation.rotation, there_from_here_.rotation), 0.1);
    EXPECT_LT((relation.translation - there_from_here_.translation).norm(), 0.05 * there_from_here_.scale);
    EXPECT_GT(found.relation.log_scale_sigma, 0);
    EXPECT_LT(found.relation.log_scale_sigma, 0.015);
    for (const SharedPoint& p : found.points) {
      EXPECT_LT((p.position - points_[p.there]).norm(), 0.1 * points_[p.there].z());
    }
  }

  TrackingRig rig_;
  std::vector<Eigen::Vector3d> points_;  // of the world `here`
  Similarity3 there_from_here_{3.5, exp_so3({0.4, -0.7, 0.1}), {2, -1, 5}};
  Map here_, there_;
  std::vector<SharedView> shared_;
};

TEST_F(SharedViewsTest, CornersAndRaysTellTheRelation) {
  const auto found = relate();
  ASSERT_TRUE(found);
  expect_right(*found);
  int by_corners = 0;
  for (const SharedPoint& p : found->points) {
    if (p.here < 0) continue;
    EXPECT_EQ(p.here, p.there);  // tracks have the numbers of their points in both
    ++by_corners;
  }
  EXPECT_GT(by_corners, kPoints / 3);
  EXPECT_GT(std::ssize(found->points) - by_corners, kPoints / 4);
  EXPECT_TRUE(std::ranges::is_sorted(found->points, {}, &SharedPoint::there));
}

// A turn has brought into view what has no position yet.
TEST_F(SharedViewsTest, RaysAloneDo) {
  for (Track& t : here_.tracks) t.triangulated = false;
  const auto found = relate();
  ASSERT_TRUE(found);
  expect_right(*found);
  EXPECT_TRUE(std::ranges::all_of(found->points, [](const SharedPoint& p) { return p.here < 0; }));
}

TEST_F(SharedViewsTest, OneViewDoesNotDo) {
  shared_.resize(2);
  EXPECT_TRUE(relate());
  shared_.resize(1);
  EXPECT_FALSE(relate());
}

// Seen from one place twice: no rays meet there, and few corners are left.
TEST_F(SharedViewsTest, WithoutParallaxThereIsNoScale) {
  for (Track& t : here_.tracks) t.triangulated = false;
  shared_ = {shared_[0], shared_[0]};
  EXPECT_FALSE(relate());
}

TEST_F(SharedViewsTest, AScaleThatIsKnownMustAgree) {
  EXPECT_FALSE(relate(true));
}

TEST_F(SharedViewsTest, PointsOfNoOneScaleAreRefused) {
  Rng rng(3);
  for (size_t p = 0; p < there_.tracks.size(); ++p) {
    const Rigid3& pose = shared_[1].rig_from_there;
    there_.tracks[p].position =
        pose.inverse() * (std::exp(0.4 * rng.normal()) * (pose * there_.tracks[p].position));
  }
  EXPECT_FALSE(relate());
}

// The scale is told by the scatter of its points: few that scatter do not tell it well enough.
TEST_F(SharedViewsTest, AScaleThatIsHardlyToldIsRefused) {
  Rng rng(3);
  for (Track& t : there_.tracks) {
    const Rigid3& pose = shared_[1].rig_from_there;
    t.position = pose.inverse() * (std::exp(0.1 * rng.normal()) * (pose * t.position));
  }
  EXPECT_TRUE(relate());
  for (SharedView& v : shared_) {
    std::vector<TrackPixel> few;
    std::vector<Eigen::Vector2f> instant_pixels;
    for (size_t i = 0; i < v.matches.size(); ++i) {
      if (v.matches[i].track % 5 != 0) continue;
      few.push_back(v.matches[i]);
      instant_pixels.push_back(v.instant_pixels[i]);
    }
    v.matches = std::move(few);
    v.instant_pixels = std::move(instant_pixels);
  }
  EXPECT_FALSE(relate());
}

// One of the views is posed elsewhere there: what it shows is not where the others put it.
TEST_F(SharedViewsTest, ViewsThatDisagreeAreRefused) {
  shared_.resize(2);
  shared_[0].rig_from_there = Rigid3{exp_so3({0, 0.3, 0}), {}} * shared_[0].rig_from_there;
  shared_[1].rig_from_there = Rigid3{exp_so3({0.3, 0, 0}), {}} * shared_[1].rig_from_there;
  EXPECT_FALSE(relate());
}

}  // namespace
}  // namespace raysfm
