#include "raysfm/places/meeting.h"

#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/geometry/rotation.h"
#include "raysfm/places/place_memory.h"
#include "support/true_map.h"

namespace raysfm {
namespace {

using namespace testing_support;

// Turns a key frame so that what it sees moves by about so many pixels.
void turn(const TrackingRig& rig, double pixels, MapKeyFrame* k) {
  const Eigen::Vector3d axis = rig.camera(0).rig_from_cam.rotation * Eigen::Vector3d::UnitY();
  const Rigid3 by{exp_so3(axis * pixels / rig.pixels_per_radian(0)), Eigen::Vector3d::Zero()};
  k->rig_from_world = by * k->rig_from_world;
}

TEST(FitsTogether, UntilAKeyFrameIsOff) {
  TrueMap m = true_map(PanelWorld(3), 4);
  EXPECT_TRUE(fits_together(m.rig, m.map));
  turn(m.rig, 0.5, &m.map.keyframes[2]);
  EXPECT_TRUE(fits_together(m.rig, m.map));
  turn(m.rig, 1, &m.map.keyframes[2]);
  EXPECT_FALSE(fits_together(m.rig, m.map));
}

TEST(FitsTogether, ByAnglesToo) {
  TrueMap m = true_map(PanelWorld(3), 4);
  const TrackingRig rig(m.rig.rig(), ErrorMeasure::kAngular);
  for (MapKeyFrame& k : m.map.keyframes) {
    for (int f = 0; f < k.size(); ++f) ASSERT_TRUE(rig.observe(0, k.pixels[f], &k.rays.emplace_back()));
  }
  EXPECT_TRUE(fits_together(rig, m.map));
  turn(rig, 1.5, &m.map.keyframes[2]);
  EXPECT_FALSE(fits_together(rig, m.map));
}

// Some fit badly whatever is done.
TEST(FitsTogether, OneOfAHundredMayBeOff) {
  TrueMap m = true_map(PanelWorld(3), 2);
  const MapKeyFrame good = m.map.keyframes[1];
  while (m.map.keyframes.size() < 100) m.map.keyframes.push_back(good);
  turn(m.rig, 3, &m.map.keyframes[50]);
  EXPECT_TRUE(fits_together(m.rig, m.map));
  turn(m.rig, 3, &m.map.keyframes[51]);
  EXPECT_FALSE(fits_together(m.rig, m.map));
}

// A loop of 49 steps of a metre, at whose end the beginning is seen from so many metres beside.
Meeting loop_that_drifted(double drift, Map* map) {
  map->keyframes.resize(50);
  for (int k = 0; k < 50; ++k) map->keyframes[k].rig_from_world.translation.z() = -k;
  Meeting meeting;
  meeting.here.keyframe = 49;
  meeting.place.rig_from_world = map->keyframes[49].rig_from_world;
  meeting.place.rig_from_world.translation.x() += drift;
  return meeting;
}

TEST(Loops, AreUsualUpToAFiftiethOfTheirLength) {
  Map map;
  EXPECT_TRUE(is_usual(loop_that_drifted(0.9, &map), map));
  const Meeting far = loop_that_drifted(1.1, &map);
  EXPECT_FALSE(is_usual(far, map));
  EXPECT_TRUE(is_plausible(far, map));
}

// A path of which a half has another scale is as much too short; its scale may change by a hundredth with
// each key frame and a tenth besides.
TEST(Loops, MayHaveDriftedAsFarAsTheirScaleTells) {
  Map map;
  Meeting far = loop_that_drifted(20, &map);
  EXPECT_FALSE(is_plausible(far, map));
  for (const double log_scale : {-0.55, 0.55}) {
    far.relation.there_from_here.scale = std::exp(log_scale);
    EXPECT_TRUE(is_plausible(far, map));
  }
  far.relation.there_from_here.scale = std::exp(-0.65);
  EXPECT_FALSE(is_plausible(far, map));
}

// Meetings of a key frame, as told one after another.
struct ToldMeetings {
  explicit ToldMeetings(double log10_false_alarms) {
    meeting.here.keyframe = 3;
    meeting.place.log10_false_alarms = log10_false_alarms;
  }
  bool is_told_again() { return memory.is_told_again(meeting, worlds); }

  TrueMap m = true_map(PanelWorld(3), 4);
  std::vector<Map*> worlds{&m.map};
  PlaceMemory memory{m.rig, 1};
  Meeting meeting;
};

// What would be said once by a street that repeats itself: 3.1 m from there another house is like it.
TEST(Loops, AreToldAgainByTheSameDrift) {
  ToldMeetings told(-20);
  EXPECT_FALSE(told.is_told_again());
  told.meeting.relation.there_from_here.translation.x() = 3.1;
  EXPECT_FALSE(told.is_told_again());
  EXPECT_TRUE(told.is_told_again());
}

// What is told by little must be told more often.
TEST(Loops, AreToldBySeveralThatSayLittle) {
  ToldMeetings told(-10);
  EXPECT_FALSE(told.is_told_again());
  EXPECT_FALSE(told.is_told_again());
  EXPECT_TRUE(told.is_told_again());
}

}  // namespace
}  // namespace raysfm
