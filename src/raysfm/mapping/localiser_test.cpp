#include "raysfm/mapping/localiser.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <map>
#include <set>

#include "support/pose_errors.h"
#include "support/true_map.h"

namespace raysfm {
namespace {

using testing_support::crooked_rig;
using testing_support::film;
using testing_support::PanelWorld;
using testing_support::pose_error;
using testing_support::true_map;
using testing_support::true_pose;
using testing_support::TrueMap;

constexpr int kAllNear = 10;  // reach of local maps
constexpr SearchRange kSearch{15, 300};

// delta with truth = retract(estimate, delta): the tangent that the covariance speaks of.
class LocaliserTest : public testing::Test {
 protected:
  static const TrueMap& three_keyframes() {
    static const TrueMap map = true_map(PanelWorld(7), 3);
    return map;
  }

  PanelWorld world_{7};
  const TrueMap& truth_ = three_keyframes();
  OdometryOptions options_;
  Localiser localiser_{truth_.rig, options_};
  LocalMap local_ = make_local_map(truth_.map, truth_.views, truth_.rig, 2, kAllNear);

  Localisation localise(const View& view, const Rigid3& predicted) {
    return localiser_.localise(truth_.map, truth_.views, local_, view, predicted, kSearch);
  }
};

// 8 pixels off by rotation, about 3 more by translation.
const Eigen::Matrix<double, 6, 1> kPredictionError =
    (Eigen::Matrix<double, 6, 1>() << 0.04, -0.02, 0.05, 0.015, -0.03, 0.02).finished();

TEST_F(LocaliserTest, FindsThePoseFromAPredictionThatIsPixelsOff) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const ViewPtr view = film(world_, truth_.rig.camera(0), pose, 3);
  const Localisation found = localise(*view, retract(pose, kPredictionError));
  ASSERT_TRUE(found.ok) << found.reason;
  EXPECT_LT(pose_error(pose, found.rig_from_world).head<3>().norm(), 0.003);
  EXPECT_LT(pose_error(pose, found.rig_from_world).tail<3>().norm(), 0.0008);
  EXPECT_GT(found.matches.size(), 200u);
  EXPECT_LE(static_cast<int>(found.matches.size()), found.visible);
  EXPECT_LT(found.sigma_px, 0.3);
}

TEST_F(LocaliserTest, FollowsAViewWithoutCorners) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const ViewPtr view = images_of(*film(world_, truth_.rig.camera(0), pose, 3));
  ASSERT_EQ(view->cameras[0].features.size(), 0);
  const auto follow = [&](double error) {
    return localiser_.follow(truth_.map, truth_.views, local_, *view,
                             retract(pose, error * kPredictionError));
  };
  const Localisation found = follow(1);
  ASSERT_TRUE(found.ok) << found.reason;
  EXPECT_LT(pose_error(pose, found.rig_from_world).head<3>().norm(), 0.003);
  EXPECT_LT(pose_error(pose, found.rig_from_world).tail<3>().norm(), 0.0008);
  EXPECT_GT(found.matches.size(), 200u);
  EXPECT_FALSE(follow(5).ok) << "55 pixels off";
}

// Otherwise most of the anchor would seem out of sight, and the next view would become a key frame, and all
// after it.
TEST_F(LocaliserTest, OfALargeLocalMapThePointsThatAreLookedForCount) {
  constexpr int kTimes = 4;
  LocalMap large{.anchor = local_.anchor, .points = {}};
  for (const LocalPoint& p : local_.points) large.points.insert(large.points.end(), kTimes, p);
  ASSERT_GT(large.points.size(), 1600u);
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const ViewPtr view = images_of(*film(world_, truth_.rig.camera(0), pose, 3));
  const Localisation of_many = localiser_.follow(truth_.map, truth_.views, large, *view, pose);
  const Localisation of_each = localiser_.follow(truth_.map, truth_.views, local_, *view, pose);
  ASSERT_TRUE(of_many.ok && of_each.ok);
  EXPECT_LT(of_many.visible, 1600);
  const auto part_in_sight = [](const Localisation& l) {
    return double(l.visible_in_anchor) / l.anchor_points;
  };
  EXPECT_GT(part_in_sight(of_each), 0.8);
  EXPECT_NEAR(part_in_sight(of_many), part_in_sight(of_each), 0.01);
}

// A picture taken while the rig turned by `turn` in all, about `pose`.
ViewPtr film_turning(const PanelWorld& world, const Camera& camera, const Rigid3& pose,
                     const Eigen::Vector3d& turn) {
  constexpr int kInstants = 25;
  Rng rng(3);
  std::vector<int> sums;
  GrayImage image;
  for (int i = 0; i < kInstants; ++i) {
    Eigen::Matrix<double, 6, 1> moved = Eigen::Matrix<double, 6, 1>::Zero();
    moved.tail<3>() = (double(i) / (kInstants - 1) - 0.5) * turn;
    image = testing_support::picture(world, camera, retract(pose, moved), rng);
    sums.resize(static_cast<size_t>(image.width()) * image.height());
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x) sums[y * image.width() + x] += image.row(y)[x];
    }
  }
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      image.row(y)[x] = static_cast<uint8_t>((sums[y * image.width() + x] + kInstants / 2) / kInstants);
    }
  }
  return testing_support::as_view(std::move(image), 3);
}

// The pose is that of the middle of the exposure.
TEST_F(LocaliserTest, FollowsAViewThatMovedWhileItWasExposed) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const Eigen::Vector3d turn(0.03, 0.055, 0.012);  // about 18 pixels
  const ViewPtr view = film_turning(world_, truth_.rig.camera(0), pose, turn);
  const auto follow = [&](Focus focus) {
    return localiser_.follow(truth_.map, truth_.views, local_, *view, retract(pose, kPredictionError), focus);
  };
  const Localisation sharp = follow(Focus::kSharp), found = follow(Focus::kBlurred);
  ASSERT_TRUE(found.ok) << found.reason;
  EXPECT_GT(found.matches.size(), 1.25 * static_cast<double>(sharp.matches.size()));
  EXPECT_GT(found.blurred, 50);
  EXPECT_EQ(sharp.blurred, 0);
  const Eigen::Matrix<double, 6, 1> error = pose_error(pose, found.rig_from_world);
  EXPECT_LT(error.tail<3>().norm(), 0.1 * turn.norm());
  EXPECT_LT(error.head<3>().norm(), 0.03);
  const auto size_of = [](const Matrix6d& c) { return std::sqrt(c.topLeftCorner<3, 3>().trace()); };
  const ViewPtr still = film(world_, truth_.rig.camera(0), pose, 3);
  const Localisation in_focus = localiser_.follow(truth_.map, truth_.views, local_, *still, pose);
  EXPECT_GT(size_of(found.covariance), 2 * size_of(in_focus.covariance));
}

// Half of what was found, told again 0.4 pixels to the right, is taken as it is and turns the camera.
TEST_F(LocaliserTest, WhatWasFoundBeforeIsNotLookedForAgain) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const ViewPtr view = images_of(*film(world_, truth_.rig.camera(0), pose, 3));
  const Localisation found = localiser_.follow(truth_.map, truth_.views, local_, *view, pose);
  ASSERT_TRUE(found.ok) << found.reason;
  std::vector<PointMatch> moved(found.matches.begin(),
                                found.matches.begin() + static_cast<ptrdiff_t>(found.matches.size() / 2));
  for (PointMatch& m : moved) m.pixel.x() += 0.4f;
  const Localisation again = localiser_.follow_again(truth_.map, truth_.views, local_, *view, pose, moved);
  ASSERT_TRUE(again.ok) << again.reason;
  EXPECT_NEAR(static_cast<double>(again.matches.size()), static_cast<double>(found.matches.size()),
              0.05 * static_cast<double>(found.matches.size()));
  std::map<int, Eigen::Vector2f> told;
  for (const PointMatch& m : moved) told[m.track] = m.pixel;
  int kept = 0, looked_for = 0;
  for (const PointMatch& m : again.matches) {
    const auto at = told.find(m.track);
    if (at == told.end()) {
      ++looked_for;
    } else {
      EXPECT_EQ(m.pixel, at->second);
      ++kept;
    }
  }
  EXPECT_GT(kept, 0.9 * static_cast<double>(moved.size()));
  EXPECT_GT(looked_for, 0.8 * static_cast<double>(moved.size()));
}

TEST_F(LocaliserTest, MatchesAreWhereTheFrameSeesTheTracks) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const Camera& camera = truth_.rig.camera(0);
  const ViewPtr view = film(world_, camera, pose, 3);
  const Localisation found = localise(*view, retract(pose, kPredictionError));
  ASSERT_TRUE(found.ok) << found.reason;
  std::set<int> seen_by_anchor(truth_.map.keyframes[2].tracks.begin(), truth_.map.keyframes[2].tracks.end());
  std::set<int> tracks;
  int with_anchor = 0;
  for (const PointMatch& m : found.matches) {
    EXPECT_TRUE(tracks.insert(m.track).second) << "track " << m.track << " twice";
    Eigen::Vector2d expected;
    ASSERT_TRUE(camera.project(camera.rig_from_cam.inverse() * (pose * truth_.map.tracks[m.track].position),
                               &expected));
    EXPECT_LT((expected - m.pixel.cast<double>()).norm(), 2.2);
    EXPECT_EQ(m.in_anchor, seen_by_anchor.contains(m.track));
    with_anchor += m.in_anchor;
  }
  EXPECT_EQ(found.matched_with_anchor, with_anchor);
}

TEST_F(LocaliserTest, WhatMovesByItselfIsNoMatch) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const Camera& camera = truth_.rig.camera(0);
  Rng rng(0, 3);
  const GrayImage still = picture(world_, camera, pose, rng);
  // A part of the image that has gone 3 pixels to the right and 2 down.
  constexpr int kLeft = 40, kTop = 60, kWidth = 90, kHeight = 80;
  GrayImage image(320, 240);
  for (int y = 0; y < 240; ++y) std::copy_n(still.row(y), 320, image.row(y));
  for (int y = kTop; y < kTop + kHeight; ++y) {
    std::copy_n(still.row(y - 2) + kLeft - 3, kWidth, image.row(y) + kLeft);
  }
  const ViewPtr view = testing_support::as_view(std::move(image), 3);
  const Localisation found = localise(*view, pose);
  ASSERT_TRUE(found.ok) << found.reason;
  EXPECT_LT(pose_error(pose, found.rig_from_world).head<3>().norm(), 0.004);
  const auto moved = [&](const Eigen::Vector2f& p) {
    return p.x() > kLeft + 8 && p.x() < kLeft + kWidth - 8 && p.y() > kTop + 8 && p.y() < kTop + kHeight - 8;
  };
  EXPECT_EQ(std::count_if(found.matches.begin(), found.matches.end(),
                          [&](const PointMatch& m) { return moved(m.pixel); }),
            0);
  const std::vector<Eigen::Vector2f>& corners = view->cameras[0].features.pixels;
  EXPECT_GT(std::count_if(corners.begin(), corners.end(), moved), 20) << "nothing moves";
  EXPECT_GT(found.matches.size(), 150u);
}

// The normalised squared error of 6 parameters has mean 6; patches are approximations, so that the errors
// may be somewhat larger than the noise alone makes them. The frames of one world share the noise of its
// key frames, so that they are one draw: the mean is over worlds.
TEST(LocaliserCovariance, TellsTheError) {
  const OdometryOptions options;
  double sum = 0;
  int frames = 0;
  for (int w = 0; w < 6; ++w) {
    const PanelWorld world(7 + 10 * w);
    const TrueMap truth = true_map(world, 3);
    const LocalMap local = make_local_map(truth.map, truth.views, truth.rig, 2, kAllNear);
    Localiser localiser(truth.rig, options);
    for (int i = 0; i < 4; ++i, ++frames) {
      const Rigid3 pose = true_pose(truth.rig, 2.1 + 0.3 * i);
      const ViewPtr view = film(world, truth.rig.camera(0), pose, 3 + i);
      const Localisation found = localiser.localise(truth.map, truth.views, local, *view,
                                                    retract(pose, 0.5 * kPredictionError), kSearch);
      ASSERT_TRUE(found.ok) << found.reason;
      const Eigen::LLT<Matrix6d> llt(found.covariance);
      ASSERT_EQ(llt.info(), Eigen::Success) << "not positive definite";
      EXPECT_LT((found.covariance - found.covariance.transpose()).norm(), 1e-12);
      const Eigen::Matrix<double, 6, 1> error = pose_error(pose, found.rig_from_world);
      sum += error.dot(llt.solve(error));
      for (int c = 0; c < 6; ++c) EXPECT_LT(std::abs(error[c]), 5 * std::sqrt(found.covariance(c, c))) << c;
    }
  }
  RecordProperty("mean_squared_error", std::to_string(sum / frames));
  EXPECT_GT(sum / frames, 3);
  EXPECT_LT(sum / frames, 20);
}

TEST_F(LocaliserTest, AFrameThatLooksElsewhereHasAReasonInsteadOfAPose) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const ViewPtr view = film(world_, truth_.rig.camera(0), pose, 3);
  for (const Eigen::Vector3d& turn : {Eigen::Vector3d(0, 0.6, 0), Eigen::Vector3d(0, 3.0, 0)}) {
    Eigen::Matrix<double, 6, 1> far = Eigen::Matrix<double, 6, 1>::Zero();
    far.tail<3>() = turn;
    const Localisation found = localise(*view, retract(pose, far));
    EXPECT_FALSE(found.ok);
    EXPECT_FALSE(found.reason.empty());
    EXPECT_TRUE(found.matches.empty());
  }
}

TEST_F(LocaliserTest, AFrameOfAnotherSceneHasAReasonInsteadOfAPose) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const ViewPtr other = film(PanelWorld(1234), truth_.rig.camera(0), pose, 3);
  const ViewPtr black = testing_support::black_view(320, 240, 3);
  for (const View* view : {other.get(), black.get()}) {
    const Localisation found = localise(*view, pose);
    EXPECT_FALSE(found.ok);
    EXPECT_FALSE(found.reason.empty());
  }
}

TEST_F(LocaliserTest, PoseFromMatchesBearsAThirdOfOutliers) {
  const Rigid3 pose = true_pose(truth_.rig, 3);
  const Camera& camera = truth_.rig.camera(0);
  Rng rng(5);
  std::vector<TrackPixel> matches;
  for (size_t t = 0; t < truth_.map.tracks.size(); ++t) {
    Eigen::Vector2d pixel;
    if (!camera.project(camera.rig_from_cam.inverse() * (pose * truth_.map.tracks[t].position), &pixel))
      continue;
    if (t % 3 == 0) pixel = {rng.uniform(0, 320), rng.uniform(0, 240)};
    matches.push_back({static_cast<int>(t), 0, 0, pixel.cast<float>()});
  }
  const Localisation found = localiser_.pose_from_matches(truth_.map, matches, 3);
  ASSERT_TRUE(found.ok);
  EXPECT_LT(pose_error(pose, found.rig_from_world).head<3>().norm(), 0.002);
  EXPECT_LT(pose_error(pose, found.rig_from_world).tail<3>().norm(), 0.0005);
  for (const PointMatch& m : found.matches) EXPECT_NE(m.track % 3, 0);

  for (TrackPixel& m : matches) m.pixel = {float(rng.uniform(0, 320)), float(rng.uniform(0, 240))};
  EXPECT_FALSE(localiser_.pose_from_matches(truth_.map, matches, 3).ok);
  EXPECT_FALSE(localiser_.pose_from_matches(truth_.map, {}, 3).ok);
}

TEST_F(LocaliserTest, RefineFollowsPointsThatHaveMoved) {
  const Rigid3 pose = true_pose(truth_.rig, 2.8);
  const ViewPtr view = film(world_, truth_.rig.camera(0), pose, 3);
  const Localisation found = localise(*view, pose);
  ASSERT_TRUE(found.ok) << found.reason;
  const std::vector<TrackPixel> matches(found.matches.begin(), found.matches.end());

  Map map = truth_.map;
  const Rigid3 shift{Eigen::Quaterniond::Identity(), {0.02, 0.01, -0.03}};
  for (Track& track : map.tracks) track.position = shift * track.position;
  Rigid3 moved = found.rig_from_world;
  Matrix6d covariance;
  ASSERT_TRUE(localiser_.refine(map, matches, &moved, &covariance));
  EXPECT_LT(pose_error(found.rig_from_world * shift.inverse(), moved).norm(), 1e-5);
  EXPECT_LT((covariance - found.covariance).norm(), 0.05 * found.covariance.norm());

  for (Track& track : map.tracks) track.triangulated = false;
  const Rigid3 before = moved;
  EXPECT_FALSE(localiser_.refine(map, matches, &moved, &covariance));
  EXPECT_EQ(moved.translation, before.translation);
  EXPECT_EQ(moved.rotation.coeffs(), before.rotation.coeffs());
}

// Key frames that look this way (0) or backwards (1); each has tracks of its own, all before its camera.
class LocalMapTest : public testing::Test {
 protected:
  void add_keyframe(bool backwards, double side, int tracks) {
    const int k = static_cast<int>(map_.keyframes.size());
    const Rigid3 world_from_cam{exp_so3({0, backwards ? std::numbers::pi : 0.0, 0}), {side, 0, 0}};
    map_.keyframes.emplace_back().rig_from_world = rig_.camera(0).rig_from_cam * world_from_cam.inverse();
    for (int i = 0; i < tracks; ++i) {
      const Eigen::Vector2d pixel(20 + 280 * rng_.uniform(), 20 + 200 * rng_.uniform());
      const Ray ray = testing_support::world_ray(rig_.camera(0), map_.keyframes[k].rig_from_world, pixel);
      const int track = static_cast<int>(map_.tracks.size());
      map_.tracks.push_back({ray.origin + 5 * ray.direction, true, {}, {}});
      map_.observe(track, k, map_.keyframes[k].add(0, pixel.cast<float>(), 0, track));
    }
  }
  // Key frame k sees a track too.
  void see(int track, int k) {
    const Camera& camera = rig_.camera(0);
    Eigen::Vector2d pixel;
    ASSERT_TRUE(camera.project(
        camera.rig_from_cam.inverse() * (map_.keyframes[k].rig_from_world * map_.tracks[track].position),
        &pixel));
    map_.observe(track, k, map_.keyframes[k].add(0, pixel.cast<float>(), 0, track));
  }
  LocalMap make(int anchor, int reach) {
    views_.clear();
    const ViewPtr view = testing_support::as_view(testing_support::flat_image(320, 240, 100), 0);
    for (const MapKeyFrame& k : map_.keyframes) {
      views_.push_back(make_keyframe_view(view, k, rig_));
    }
    return make_local_map(map_, views_, rig_, anchor, reach);
  }
  std::set<int> tracks_of(const LocalMap& local) {
    std::set<int> tracks;
    for (const LocalPoint& p : local.points) tracks.insert(p.track);
    return tracks;
  }
  bool has_all(const LocalMap& local, int keyframe) {
    const std::set<int> tracks = tracks_of(local);
    for (const int t : map_.keyframes[keyframe].tracks) {
      if (!tracks.contains(t)) return false;
    }
    return true;
  }

  TrackingRig rig_ = crooked_rig();
  Map map_;
  std::vector<KeyFrameView> views_;
  Rng rng_{3};
};

TEST_F(LocalMapTest, TakesTheKeyFramesThatTheAnchorSeesMostOfWhateverTheirAge) {
  add_keyframe(false, 0.1, 160);  // as old as can be, at the same place
  add_keyframe(false, 3.0, 160);  // sees a part of it
  for (int k = 0; k < 4; ++k) add_keyframe(true, 0, 160);
  add_keyframe(false, 0.0, 160);  // the anchor

  const LocalMap none = make(6, 0), one = make(6, 1), two = make(6, 2), many = make(6, 10);
  EXPECT_EQ(none.anchor, 6);
  EXPECT_EQ(none.points.size(), 160u);
  EXPECT_TRUE(has_all(none, 6));
  EXPECT_EQ(one.points.size(), 320u);
  EXPECT_TRUE(has_all(one, 6) && has_all(one, 0));
  EXPECT_EQ(two.points.size(), 480u);
  EXPECT_TRUE(has_all(two, 6) && has_all(two, 0) && has_all(two, 1));
  EXPECT_EQ(many.points.size(), 480u) << "key frames that look backwards have nothing to offer";
}

TEST_F(LocalMapTest, HoldsEachTrackOnceWithAFeatureThatSawIt) {
  add_keyframe(false, 0.0, 200);
  add_keyframe(false, 0.1, 200);
  add_keyframe(false, 0.2, 200);
  for (int t = 0; t < 200; t += 2) see(t, 1);
  for (int t = 0; t < 200; t += 4) see(t, 2);
  for (int t = 200; t < 400; t += 5) see(t, 2);
  const LocalMap local = make(2, 10);

  EXPECT_EQ(local.points.size(), tracks_of(local).size());
  EXPECT_EQ(local.points.size(), 600u);
  const MapArray<int>& anchor_tracks = map_.keyframes[2].tracks;
  int last_keyframe = 0;
  for (const LocalPoint& p : local.points) {
    EXPECT_GE(p.keyframe, last_keyframe) << "not sorted by key frame";
    last_keyframe = p.keyframe;
    ASSERT_LT(p.feature, map_.keyframes[p.keyframe].size());
    EXPECT_EQ(map_.keyframes[p.keyframe].tracks[p.feature], p.track);
    EXPECT_EQ(p.in_anchor, std::count(anchor_tracks.begin(), anchor_tracks.end(), p.track) == 1);
  }
}

TEST_F(LocalMapTest, PointsOfTheAnchorComeBeforeThoseOfOthersWhereThereAreTooMany) {
  for (int k = 0; k < 12; ++k) add_keyframe(false, 0.01 * k, 300);
  for (int anchor : {0, 6, 11}) {
    const LocalMap local = make(anchor, 11);
    EXPECT_TRUE(has_all(local, anchor)) << anchor;
    EXPECT_LT(local.points.size(), 12u * 300u) << "the work per frame must stay bounded";
  }
}

TEST_F(LocalMapTest, LeavesOutOutliersAndTracksWithoutAPosition) {
  add_keyframe(false, 0.0, 100);
  add_keyframe(false, 0.1, 100);
  map_.keyframes[1].inliers[3] = 0;
  map_.tracks[map_.keyframes[1].tracks[5]].triangulated = false;
  map_.keyframes[0].inliers[7] = 0;
  const std::set<int> tracks = tracks_of(make(1, 10));
  EXPECT_EQ(tracks.size(), 197u);
  EXPECT_FALSE(tracks.contains(map_.keyframes[1].tracks[3]));
  EXPECT_FALSE(tracks.contains(map_.keyframes[1].tracks[5]));
  EXPECT_FALSE(tracks.contains(map_.keyframes[0].tracks[7]));
}

}  // namespace
}  // namespace raysfm
