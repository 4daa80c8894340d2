#include "raysfm/matching/across_matcher.h"

#include <gtest/gtest.h>

#include <numeric>
#include <set>

#include "raysfm/matching/extrinsics_check.h"

#include "support/panel_world.h"

namespace raysfm {
namespace {

using testing_support::PanelWorld;
using testing_support::small_camera;
using testing_support::world_ray;

Rig stereo() {
  Rig rig{{small_camera(), small_camera()}};
  rig.cameras[0].rig_from_cam.translation = {-0.1, 0, 0};
  rig.cameras[1].rig_from_cam = {exp_so3({0.02, -0.05, 0.03}), {0.1, 0.01, 0}};
  return rig;
}

// What both cameras see of a world at one instant.
ViewPtr film_both(const PanelWorld& world, const PanelWorld& other, const Rig& rig) {
  auto view = std::make_shared<View>();
  const PanelWorld* worlds[2] = {&world, &other};
  for (int c = 0; c < 2; ++c) {
    CameraView& image = view->cameras.emplace_back();
    Rng rng(0, static_cast<uint64_t>(c));
    image.image = picture(*worlds[c], rig.cameras[c], Rigid3{}, rng);
    HarrisDetector detector;
    detect(detector, HarrisOptions{.max_features = 600, .mask = {}}, &image);
  }
  return view;
}

class AcrossMatcherTest : public testing::Test {
 protected:
  std::vector<AcrossMatch> match(const ViewPtr& view) {
    MapKeyFrame keyframe;
    for (int c = 0; c < 2; ++c) {
      const Features& features = view->cameras[c].features;
      for (int f = 0; f < features.size(); ++f) {
        keyframe.add(c, features.pixels[f], features.octaves[f], -1);
      }
    }
    pixels_.assign(keyframe.pixels.begin(), keyframe.pixels.end());
    cameras_.assign(keyframe.cameras.begin(), keyframe.cameras.end());
    std::vector<int> all(keyframe.size());
    std::iota(all.begin(), all.end(), 0);
    std::vector<AcrossMatch> matches;
    matcher_.match(rig_, make_keyframe_view(view, keyframe, rig_), *view, all, &matches);
    return matches;
  }

  TrackingRig rig_{stereo()};
  AcrossMatcher matcher_;
  std::vector<Eigen::Vector2f> pixels_;
  std::vector<int> cameras_;
};

TEST_F(AcrossMatcherTest, FindsThePlaceWhereTheOtherCameraSeesThePoint) {
  const PanelWorld world(7);
  const std::vector<AcrossMatch> matches = match(film_both(world, world, rig_.rig()));
  EXPECT_GT(matches.size(), 150u);
  std::set<int> features;
  int right = 0;
  for (const AcrossMatch& m : matches) {
    EXPECT_TRUE(features.insert(m.feature).second);
    EXPECT_EQ(cameras_[m.feature], 0);
    EXPECT_EQ(m.camera, 1);
    const auto point = world.hit(world_ray(rig_.camera(0), Rigid3{}, pixels_[m.feature].cast<double>()));
    Eigen::Vector2d expected;
    right += point && rig_.camera(1).project(rig_.cam_from_rig(1) * *point, &expected) &&
             (expected - m.pixel.cast<double>()).norm() < 0.7;
  }
  EXPECT_GT(right, 0.95 * static_cast<double>(matches.size()));
}

// Along a line there is always something that looks alike; one in twenty corners finds it.
TEST_F(AcrossMatcherTest, ImagesOfDifferentPlacesHaveHardlyAnyMatches) {
  EXPECT_LT(match(film_both(PanelWorld(7), PanelWorld(99), rig_.rig())).size(), 40u);
}

TEST_F(AcrossMatcherTest, ExtrinsicsInTheOppositeDirectionAreNoticed) {
  const PanelWorld world(7);
  const ViewPtr view = film_both(world, world, rig_.rig());
  EXPECT_FALSE(opposite_extrinsics(rig_, *view));
  Rig wrong = rig_.rig();
  for (Camera& camera : wrong.cameras) camera.rig_from_cam = camera.rig_from_cam.inverse();
  const std::optional<std::string> problem = opposite_extrinsics(TrackingRig(wrong), *view);
  ASSERT_TRUE(problem);
  EXPECT_NE(problem->find("opposite direction"), std::string::npos) << *problem;
  EXPECT_FALSE(opposite_extrinsics(rig_, *film_both(world, PanelWorld(99), rig_.rig())));
}

}  // namespace
}  // namespace raysfm
