#include "raysfm/places/meeting.h"

#include <gtest/gtest.h>

#include "raysfm/geometry/rotation.h"
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

}  // namespace
}  // namespace raysfm
