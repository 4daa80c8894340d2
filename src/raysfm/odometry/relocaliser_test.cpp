#include "raysfm/odometry/relocaliser.h"

#include <gtest/gtest.h>

#include "support/true_map.h"

namespace raysfm {
namespace {

using testing_support::film;
using testing_support::PanelWorld;
using testing_support::true_map;
using testing_support::true_pose;
using testing_support::TrueMap;

class RelocaliserTest : public testing::Test {
 protected:
  // The view of the camera turned about its axis.
  Rigid3 turned(double step, double angle) const {
    const Rigid3& rig_from_cam = truth_.rig.camera(0).rig_from_cam;
    const Rigid3 turn{exp_so3({0, 0, angle}), {0, 0, 0}};
    return rig_from_cam * turn * rig_from_cam.inverse() * true_pose(truth_.rig, step);
  }
  ViewPtr view_from(const Rigid3& rig_from_world, uint64_t seed = 7) const {
    return film(PanelWorld(seed), truth_.rig.camera(0), rig_from_world, 9);
  }
  // Matches within three pixels of where the pose sees the tracks.
  int right(const Place& place, const Rigid3& rig_from_world) const {
    int count = 0;
    for (const TrackPixel& m : place.matches) {
      Eigen::Vector2d pixel;
      const Eigen::Vector3d point =
          truth_.rig.cam_from_rig(0) * (rig_from_world * truth_.map.tracks[m.track].position);
      count += truth_.rig.find(0, point, &pixel) && (pixel - m.pixel.cast<double>()).norm() < 3;
    }
    return count;
  }
  std::vector<Place> search(const View& view) { return relocaliser_.search(truth_.map, truth_.views, view); }

  TrueMap truth_ = true_map(PanelWorld(7), 3);
  Relocaliser relocaliser_;
};

TEST_F(RelocaliserTest, FindsPointsOfAPlaceHoweverTheCameraIsTurned) {
  for (const double angle : {0.0, 0.7, 1.6, 3.14}) {
    const Rigid3 pose = turned(2.5, angle);
    const std::vector<Place> places = search(*view_from(pose));
    ASSERT_FALSE(places.empty()) << angle;
    EXPECT_GT(right(places[0], pose), 60) << angle;
    EXPECT_GT(right(places[0], pose), 0.8 * static_cast<double>(places[0].matches.size())) << angle;
  }
}

TEST_F(RelocaliserTest, ADifferentWorldGivesNoPose) {
  const OdometryOptions options;
  Localiser localiser(truth_.rig, options);
  for (uint64_t seed = 100; seed < 110; ++seed) {
    const ViewPtr view = view_from(turned(2.5, 0), seed);
    for (const Place& place : search(*view)) {
      EXPECT_FALSE(localiser.pose_from_matches(truth_.map, place.matches, view->frame).ok) << seed;
    }
  }
}

TEST_F(RelocaliserTest, TracksWithoutAPositionAreLeftOut) {
  const ViewPtr view = view_from(turned(1, 0));
  ASSERT_FALSE(search(*view).empty());
  for (size_t t = 0; t < truth_.map.tracks.size(); t += 2) truth_.map.tracks[t].triangulated = false;
  const std::vector<Place> places = search(*view);
  ASSERT_FALSE(places.empty());
  for (const TrackPixel& m : places[0].matches) EXPECT_EQ(m.track % 2, 1);
}

// The features of every key frame in the opposite order, without each third.
TEST_F(RelocaliserTest, FollowsTheFeaturesOfACompactedKeyFrame) {
  const Rigid3 pose = turned(1, 0.3);
  const ViewPtr view = view_from(pose);
  const auto before = search(*view)[0].matches.size();
  for (size_t k = 0; k < truth_.map.keyframes.size(); ++k) {
    MapKeyFrame& keyframe = truth_.map.keyframes[k];
    MapKeyFrame compacted;
    std::vector<int> new_index(keyframe.size(), -1);
    for (int f = keyframe.size() - 1; f >= 0; --f) {
      if (f % 3 != 0)
        new_index[f] = compacted.add(0, keyframe.pixels[f], keyframe.octaves[f], keyframe.tracks[f]);
    }
    compacted.rig_from_world = keyframe.rig_from_world;
    keyframe = compacted;
    relocaliser_.forget_features(static_cast<int>(k), new_index);
  }
  const Place place = search(*view)[0];
  EXPECT_LT(place.matches.size(), 0.9 * static_cast<double>(before));
  EXPECT_GT(right(place, pose), 40);
  EXPECT_GT(right(place, pose), 0.8 * static_cast<double>(place.matches.size()));
}

// More key frames than one search looks at: all have had their turn after a few.
TEST_F(RelocaliserTest, EveryKeyFrameHasItsTurn) {
  relocaliser_.clear();
  Map map;
  std::vector<KeyFrameView> views;
  const ViewPtr black = testing_support::black_view(320, 240, 0);
  constexpr int kKeyFrames = 40, kSeen = 17;
  for (int k = 0; k < kKeyFrames; ++k) {
    map.keyframes.push_back(k == kSeen ? truth_.map.keyframes[0] : MapKeyFrame{});
    views.emplace_back().view = k == kSeen ? truth_.views[0].view : black;
    map.tracks = truth_.map.tracks;
  }
  const ViewPtr view = view_from(turned(0, 0));
  int found = 0;
  for (int i = 0; i < 4; ++i) {
    for (const Place& place : relocaliser_.search(map, views, *view)) {
      EXPECT_EQ(place.keyframe, kSeen);
      ++found;
    }
  }
  EXPECT_EQ(found, 1);
}

}  // namespace
}  // namespace raysfm
