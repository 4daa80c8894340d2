#include "raysfm/scene/worlds.h"

#include <gtest/gtest.h>

#include "support/small_reconstruction.h"

namespace raysfm {
namespace {

using testing_support::small_reconstruction;

// Frames 0 to 2 and 3 to 11 are worlds of their own, 2 or 8 of them with a pose; every second point belongs
// to the second.
Reconstruction two_worlds() {
  Reconstruction r = small_reconstruction({Pinhole{500, 510, 319.5, 239.5}});
  r.segments = {{0, 2, "lost", false, 0.5}, {3, 11, "end of input", true, 0.01}};
  r.starts = {{"five-point", {0, 1, 2}, 20}, {"pless", {3, 6, 9}, 30}};
  r.frames[1].world_from_rig.reset();
  r.frames[1].segment = -1;
  for (int i = 3; i < 12; ++i) {
    if (r.frames[i].world_from_rig) r.frames[i].segment = 1;
  }
  for (size_t i = 0; i < r.points.size(); i += 2) r.points[i].segment = 1;
  return r;
}

TEST(Worlds, TheLongestComesFirstTheOthersInTimeOrder) {
  Reconstruction r = two_worlds();
  EXPECT_EQ(worlds_in_order(r), (std::vector{1, 0}));
  EXPECT_EQ(posed_count(r), 10);
  EXPECT_EQ(placed_count(r), 10);
  r.frames[0].place_held = true;
  EXPECT_EQ(placed_count(r), 9);
  r.frames[0].place_held = false;
  r.segments.push_back({10, 11, "end of input", false, {}});
  r.frames[10].segment = r.frames[11].segment = 2;
  EXPECT_EQ(worlds_in_order(r), (std::vector{1, 0, 2}));
  for (PosedFrame& frame : r.frames) {
    if (frame.segment == 1) frame.segment = 2;
  }
  EXPECT_EQ(worlds_in_order(r), (std::vector{2, 0}));
  EXPECT_EQ(worlds_in_order(Reconstruction{}), std::vector<int>());
}

TEST(Worlds, OfEqualsTheFirstIsTheMainOne) {
  Reconstruction r = two_worlds();
  for (int i = 5; i < 12; ++i) {
    r.frames[i].world_from_rig.reset();
    r.frames[i].segment = -1;
  }
  EXPECT_EQ(worlds_in_order(r), (std::vector{0, 1}));
}

TEST(Worlds, AWorldHoldsNothingOfAnother) {
  const Reconstruction r = two_worlds();
  const Reconstruction world = world_of(r, 1);
  ASSERT_EQ(world.frames.size(), 8u);
  EXPECT_EQ(world.frames[0].timestamp, r.frames[3].timestamp);
  EXPECT_EQ(world.frames[2].timestamp, r.frames[6].timestamp);  // frame 5 has no pose
  ASSERT_EQ(world.points.size(), 100u);
  EXPECT_EQ(world.points[7].position, r.points[14].position);
  EXPECT_TRUE(world.metric_scale);
  EXPECT_EQ(world.scale_sigma, 0.01);
  ASSERT_EQ(world.segments.size(), 1u);
  EXPECT_EQ(world.segments[0].first, 0);
  EXPECT_EQ(world.segments[0].last, 7);
  EXPECT_EQ(world.starts[0].frames, (std::vector{0, 2, 5}));

  ASSERT_EQ(world.keyframes.size(), 3u);
  size_t observations = 0;
  for (const KeyFrame& k : world.keyframes) {
    const Rigid3 cam_from_world = world.frames[k.frame].world_from_rig->inverse();
    for (int i = k.first_observation; i < k.last_observation; ++i, ++observations) {
      Eigen::Vector2d pixel;
      const Observation& o = world.observations[i];
      ASSERT_TRUE(world.rig.cameras[0].project(cam_from_world * world.points[o.point].position, &pixel));
      EXPECT_LT((pixel - o.pixel).norm(), 1e-9);
    }
  }
  EXPECT_EQ(observations, world.observations.size());
  EXPECT_GT(observations, 50u);
}

TEST(Worlds, AWorldKeepsItsOriginAndItsLenses) {
  Reconstruction r = testing_support::small_solved_reconstruction(true, {});
  r.segments = {{0, 2, "lost", false, {}}, {3, 11, "end of input", false, {}}};
  for (int i = 3; i < 12; ++i) {
    if (r.frames[i].world_from_rig) r.frames[i].segment = 1;
  }
  const Reconstruction world = world_of(r, 1);
  EXPECT_EQ(world.origin, Origin::kSolve);
  ASSERT_EQ(world.frames.size(), 8u);
  EXPECT_EQ(&camera_of(world, world.frames[0], 0), &world.lenses[3].camera);
  EXPECT_EQ(std::get<Pinhole>(camera_of(world, world.frames[0], 0).model).fx, 501);
}

TEST(FrameLens, IsMadeOfItsNumbersAndGivesThemBack) {
  const Lens lens{500, 510, 320, 240, 0.25};
  const FrameLens plain = frame_lens(lens, {}), bent = frame_lens(lens, {-0.1, 0.02});
  for (const FrameLens* made : {&plain, &bent}) {
    ASSERT_TRUE(lens_of(*made));
    EXPECT_EQ(lens_of(*made)->vector(), lens.vector());
  }
  EXPECT_EQ(model_name(plain.camera.model), "pinhole");
  EXPECT_EQ(model_name(bent.camera.model), "radtan");
  EXPECT_TRUE(radial_distortion_of(plain.camera).none());
  EXPECT_EQ(radial_distortion_of(bent.camera).k1, -0.1);
  EXPECT_EQ(radial_distortion_of(bent.camera).k2, 0.02);
  FrameLens fisheye;
  fisheye.camera.model = KannalaBrandt{500, 510, 320, 240};
  EXPECT_FALSE(lens_of(fisheye));
}

}  // namespace
}  // namespace raysfm
