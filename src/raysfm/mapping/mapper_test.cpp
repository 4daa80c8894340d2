#include "raysfm/mapping/mapper.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <span>
#include <vector>

#include "raysfm/eval/alignment.h"
#include "support/long_drive.h"
#include "support/true_map.h"

namespace raysfm {
namespace {

using testing_support::degrees_between;
using testing_support::film;
using testing_support::PanelWorld;
using testing_support::true_map;
using testing_support::true_pose;
using testing_support::TrueMap;
using testing_support::world_ray;

bool same(const Rigid3& a, const Rigid3& b) {
  return a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

Eigen::Vector3d camera_center(const TrueMap& world, int keyframe) {
  const Rigid3 world_from_rig = world.map.keyframes[keyframe].rig_from_world.inverse();
  return world_from_rig * world.rig.camera(0).rig_from_cam.translation;
}

// Where a key frame should have seen a track, minus where it did.
double reprojection_error(const TrueMap& world, const TrackObservation& o, const Eigen::Vector3d& position) {
  const Camera& camera = world.rig.camera(0);
  const MapKeyFrame& k = world.map.keyframes[o.keyframe];
  Eigen::Vector2d pixel;
  if (!camera.project(camera.rig_from_cam.inverse() * (k.rig_from_world * position), &pixel)) return 1e9;
  return (pixel - k.pixels[o.feature].cast<double>()).norm();
}

// A map in which only every third corner of the first key frame has a track, and the corners of the last one
// tracks without a position: what is there to be mapped.
class KeyFrameTest : public testing::Test {
 protected:
  KeyFrameTest() {
    const Rigid3 pose = true_pose(truth_.rig, 3);
    view_ = film(world_, camera(), pose, 2);
    Localiser localiser(truth_.rig, options_);
    localisation_ = localiser.localise(truth_.map, truth_.views,
                                       make_local_map(truth_.map, truth_.views, truth_.rig, 1, 10), *view_,
                                       pose, {10, 300});
  }
  TrueMap sparse_map() const {
    TrueMap truth = true_map(world_, 2, 3);
    start_tracks(truth.rig, *truth.views[1].view, kTrackSpacing, 1, &truth.map);
    truth.views[1] = make_keyframe_view(truth.views[1].view, truth.map.keyframes[1], truth.rig);
    return truth;
  }
  const Camera& camera() const { return truth_.rig.camera(0); }

  PanelWorld world_{7};
  TrueMap truth_ = sparse_map();
  OdometryOptions options_;
  Mapper mapper_{truth_.rig, options_};
  // Tracks with a position; those of the corners of key frame 1 follow.
  int known_ = static_cast<int>(std::count_if(truth_.map.tracks.begin(), truth_.map.tracks.end(),
                                              [](const Track& t) { return t.triangulated; }));
  ViewPtr view_;
  Localisation localisation_;
};

TEST_F(KeyFrameTest, NewPointsHaveParallaxFitTheirObservationsAndLieOnTheSurface) {
  ASSERT_TRUE(localisation_.ok) << localisation_.reason;
  mapper_.add_keyframe(view_, localisation_, Adjusting::kNow, &truth_.map, &truth_.views);
  int found = 0, true_points = 0;
  for (int t = known_; t < static_cast<int>(truth_.map.tracks.size()); ++t) {
    const Track& track = truth_.map.tracks[t];
    if (!track.triangulated) continue;
    ++found;
    double parallax = 0;
    int inliers = 0;
    for (const TrackObservation& o : track.observations) {
      if (!truth_.map.keyframes[o.keyframe].inliers[o.feature]) continue;
      ++inliers;
      EXPECT_LT(reprojection_error(truth_, o, track.position), 2.5);
      const Eigen::Vector3d& first = camera_center(truth_, track.observations[0].keyframe);
      parallax = std::max(
          parallax, degrees_between(Eigen::Vector3d(track.position - first),
                                    Eigen::Vector3d(track.position - camera_center(truth_, o.keyframe))));
    }
    EXPECT_GE(inliers, 2);
    EXPECT_GT(parallax, 0.2);
    // The point that the first pixel of the track really shows; two pixels of a baseline of 0.3 m tell the
    // distance of 7 m to about 2 %.
    const TrackObservation& o = track.observations[0];
    const Eigen::Vector2d pixel = truth_.map.keyframes[o.keyframe].pixels[o.feature].cast<double>();
    const Rigid3 pose = true_pose(truth_.rig, o.keyframe == 2 ? 3 : o.keyframe);
    const auto truth = world_.hit(world_ray(camera(), pose, pixel));
    ASSERT_TRUE(truth);
    const double distance = (*truth - camera_center(truth_, o.keyframe)).norm();
    true_points += (track.position - *truth).norm() < 0.03 * distance;
  }
  EXPECT_GT(found, 100);
  EXPECT_GT(true_points, 0.9 * found);
}

TEST_F(KeyFrameTest, TakesOverTheMatchesAndStartsTracksAtTheOtherCorners) {
  ASSERT_TRUE(localisation_.ok) << localisation_.reason;
  mapper_.add_keyframe(view_, localisation_, Adjusting::kNow, &truth_.map, &truth_.views);
  ASSERT_EQ(truth_.map.keyframes.size(), 3u);
  ASSERT_EQ(truth_.views.size(), 3u);
  const MapKeyFrame& added = truth_.map.keyframes[2];
  EXPECT_EQ(added.frame, 2);
  ASSERT_EQ(truth_.views[2].pixels.size(), added.pixels.size());
  ASSERT_EQ(truth_.views[2].directions.size(), added.pixels.size());
  std::set<int> tracks(added.tracks.begin(), added.tracks.end());
  EXPECT_EQ(tracks.size(), added.tracks.size()) << "a track twice in one key frame";
  for (const PointMatch& m : localisation_.matches) EXPECT_TRUE(tracks.contains(m.track));

  FeatureGrid grid;
  grid.build(added.pixels, camera().width, camera().height);
  const Features& corners = view_->cameras[0].features;
  for (int i = 0; i < corners.size(); ++i) {
    int near = 0;
    grid.for_each_in(corners.pixels[i], kTrackSpacing * octave_side(corners.octaves[i]),
                     [&](int) { ++near; });
    EXPECT_GE(near, 1) << "a corner without a track at " << corners.pixels[i].transpose();
  }
  for (int f = 0; f < added.size(); ++f) {
    ASSERT_GE(added.tracks[f], 0);
    const TrackObservation& o = truth_.map.tracks[added.tracks[f]].observations.back();
    EXPECT_EQ(o.keyframe, 2);
    EXPECT_EQ(o.feature, f);
  }
}

TEST_F(KeyFrameTest, ThePoseStaysTrueAndTheFirstKeyFrameStaysTheWorld) {
  ASSERT_TRUE(localisation_.ok) << localisation_.reason;
  const Rigid3 first = truth_.map.keyframes[0].rig_from_world;
  mapper_.add_keyframe(view_, localisation_, Adjusting::kNow, &truth_.map, &truth_.views);
  EXPECT_TRUE(same(truth_.map.keyframes[0].rig_from_world, first));
  // The scale may move a little, the shape not.
  const Rigid3 truth = true_pose(truth_.rig, 3).inverse(), world = first.inverse();
  const Rigid3 found = truth_.map.keyframes[2].rig_from_world.inverse();
  EXPECT_LT(degrees_between(found.rotation, truth.rotation), 0.1);
  EXPECT_LT((found.translation - truth.translation).norm(),
            0.02 * (truth.translation - world.translation).norm());
}

// At one place, and 8 mm on: parallax of an eighth of a degree is mostly error.
TEST_F(KeyFrameTest, KeyFramesWithHardlyABaselineGiveNoPoints) {
  for (const double baseline : {0.0, 0.008}) {
    TrueMap truth = sparse_map();
    Localisation near = localisation_;
    near.rig_from_world = truth.map.keyframes[1].rig_from_world;
    near.rig_from_world.translation += near.rig_from_world.rotation * Eigen::Vector3d(-baseline, 0, 0);
    near.matches.clear();
    mapper_.add_keyframe(film(world_, camera(), near.rig_from_world, 2, 99), near, Adjusting::kNow,
                         &truth.map, &truth.views);
    int found = 0, seen_twice = 0;
    for (size_t t = known_; t < truth.map.tracks.size(); ++t) {
      found += truth.map.tracks[t].triangulated;
      seen_twice += truth.map.tracks[t].observations.size() == 2;
    }
    EXPECT_GT(seen_twice, 100) << "the test has nothing to triangulate";
    EXPECT_EQ(found, 0) << baseline;
  }
}

// Ten key frames; the pixels carry noise, so that an adjustment moves what it may.
class AdjustTest : public testing::Test {
 protected:
  AdjustTest() { options_.free_cameras = 3, options_.window = 6, options_.global_until = 4; }

  void disturb_pixels(double sigma) {
    for (MapKeyFrame& k : truth_.map.keyframes) {
      for (Eigen::Vector2f& p : k.pixels)
        p += Eigen::Vector2d(rng_.normal(), rng_.normal()).cast<float>() * sigma;
    }
  }
  // Poses but the first, and points.
  void disturb_geometry(double metres, double radians) {
    const auto some = [&](double size) {
      return Eigen::Vector3d(size * rng_.normal(), size * rng_.normal(), size * rng_.normal());
    };
    for (size_t k = 1; k < truth_.map.keyframes.size(); ++k) {
      Eigen::Matrix<double, 6, 1> delta;
      delta << some(metres), some(radians);
      Rigid3& pose = truth_.map.keyframes[k].rig_from_world;
      pose = retract(pose, delta);
    }
    for (Track& track : truth_.map.tracks) track.position += some(metres);
  }
  std::vector<Rigid3> poses() const {
    std::vector<Rigid3> out;
    for (const MapKeyFrame& k : truth_.map.keyframes) out.push_back(k.rig_from_world);
    return out;
  }
  double rms() const {
    double squares = 0;
    int count = 0;
    for (const Track& track : truth_.map.tracks) {
      for (const TrackObservation& o : track.observations) {
        squares += std::pow(reprojection_error(truth_, o, track.position), 2);
        ++count;
      }
    }
    return std::sqrt(squares / count);
  }

  static const TrueMap& ten_keyframes() {
    static const TrueMap map = true_map(PanelWorld(7), 10);
    return map;
  }

  TrueMap truth_{ten_keyframes().rig, ten_keyframes().map, {}};
  OdometryOptions options_;
  Rng rng_{17};
};

TEST_F(AdjustTest, LocallyOnlyTheNewestKeyFramesMove) {
  disturb_pixels(0.5);
  const std::vector<Rigid3> before = poses();
  Mapper mapper(truth_.rig, options_);
  mapper.adjust_locally(&truth_.map);
  const std::vector<Rigid3> after = poses();
  for (int k = 0; k < 7; ++k) EXPECT_TRUE(same(before[k], after[k])) << k;
  for (int k = 7; k < 10; ++k) EXPECT_FALSE(same(before[k], after[k])) << k;
}

TEST_F(AdjustTest, EverythingMovesWhileTheMapIsSmallButTheFirstKeyFrame) {
  options_.global_until = 10;
  disturb_pixels(0.5);
  const std::vector<Rigid3> before = poses();
  Mapper mapper(truth_.rig, options_);
  mapper.adjust_locally(&truth_.map);
  const std::vector<Rigid3> after = poses();
  EXPECT_TRUE(same(before[0], after[0])) << "the first key frame is the world";
  for (int k = 1; k < 10; ++k) EXPECT_FALSE(same(before[k], after[k])) << k;
}

TEST_F(AdjustTest, PointsThatOnlyOldKeyFramesSeeStay) {
  std::vector<size_t> old;
  for (size_t t = 0; t < truth_.map.tracks.size() && old.size() < 20; ++t) {
    Track& track = truth_.map.tracks[t];
    if (track.observations.size() < 10) continue;
    for (int k = 7; k < 10; ++k) truth_.map.keyframes[k].tracks[track.observations[k].feature] = -1;
    track.observations.resize(7);
    old.push_back(t);
  }
  ASSERT_EQ(old.size(), 20u);
  disturb_pixels(0.5);
  const auto before = truth_.map.tracks;
  Mapper mapper(truth_.rig, options_);
  mapper.adjust_locally(&truth_.map);
  for (const size_t t : old) EXPECT_EQ(truth_.map.tracks[t].position, before[t].position);
  size_t moved = 0;
  for (size_t t = 0; t < before.size(); ++t) moved += truth_.map.tracks[t].position != before[t].position;
  EXPECT_GT(moved, before.size() / 2);
}

TEST_F(AdjustTest, GloballyExactPixelsLeadBackToTheTruth) {
  const std::vector<Rigid3> truth = poses();
  const Rigid3 first = truth[0];
  disturb_geometry(0.02, 0.003);
  ASSERT_GT(rms(), 1.0) << "the test disturbs nothing";
  Mapper mapper(truth_.rig, options_);
  mapper.adjust_globally(&truth_.map);
  EXPECT_LT(rms(), 0.02);
  const std::vector<Rigid3> found = poses();
  EXPECT_TRUE(same(found[0], first));
  Eigen::Matrix3Xd found_centers(3, 10), true_centers(3, 10);
  for (int k = 0; k < 10; ++k) {
    const Eigen::Vector3d& offset = truth_.rig.camera(0).rig_from_cam.translation;
    found_centers.col(k) = found[k].inverse() * offset;
    true_centers.col(k) = truth[k].inverse() * offset;
    EXPECT_LT(degrees_between(found[k].rotation, truth[k].rotation), 0.02) << k;
  }
  const Similarity3 aligned = align_points(found_centers, true_centers, Alignment::kSim3);
  for (int k = 0; k < 10; ++k) {
    EXPECT_LT((aligned * found_centers.col(k) - true_centers.col(k)).norm(), 0.002) << k;
  }
}

TEST_F(AdjustTest, WrongObservationsBecomeOutliersAndBendNothing) {
  const std::vector<Rigid3> truth = poses();
  std::set<std::pair<int, int>> wrong;
  for (int k = 7; k < 10; ++k) {
    for (int f = k; f < truth_.map.keyframes[k].size(); f += 40) {
      truth_.map.keyframes[k].pixels[f] += Eigen::Vector2f(f % 2 ? 25 : -9, f % 3 ? 12 : -30);
      wrong.insert({k, f});
    }
  }
  ASSERT_GT(wrong.size(), 20u);
  Mapper mapper(truth_.rig, options_);
  mapper.adjust_locally(&truth_.map);
  int right = 0, kept = 0;
  for (int k = 7; k < 10; ++k) {
    const MapKeyFrame& keyframe = truth_.map.keyframes[k];
    for (int f = 0; f < keyframe.size(); ++f) {
      if (wrong.contains({k, f})) {
        EXPECT_EQ(keyframe.inliers[f], 0) << k << " " << f;
      } else {
        ++right;
        kept += keyframe.inliers[f];
      }
    }
    EXPECT_LT((keyframe.rig_from_world.inverse().translation - truth[k].inverse().translation).norm(), 0.003);
  }
  EXPECT_GT(kept, 0.99 * right);
}

TEST_F(AdjustTest, APositionThatNoTwoViewsSupportIsGivenUp) {
  Track& track = truth_.map.tracks[0];
  ASSERT_GE(track.observations.size(), 8u);
  for (const TrackObservation& o : track.observations) {
    truth_.map.keyframes[o.keyframe].pixels[o.feature] +=
        Eigen::Vector2f(o.keyframe % 2 ? 60 : -50, o.keyframe % 3 ? 40 : -45);
  }
  Mapper mapper(truth_.rig, options_);
  mapper.adjust_globally(&truth_.map);
  EXPECT_FALSE(track.triangulated);
  EXPECT_TRUE(truth_.map.tracks[1].triangulated);
}

// Key frames 11 and 12 at their true poses.
class AdjustingTest : public testing::Test {
 protected:
  // Whether the map moved.
  bool adds_one(Adjusting adjusting) {
    const std::vector<MapKeyFrame> before = truth_.map.keyframes;
    const int k = static_cast<int>(before.size());
    Localisation at;
    at.ok = true;
    at.rig_from_world = true_pose(truth_.rig, k);
    const ViewPtr view = film(world_, truth_.rig.camera(0), at.rig_from_world, k);
    mapper_.add_keyframe(view, at, adjusting, &truth_.map, &truth_.views);
    return !std::ranges::equal(before, std::span(truth_.map.keyframes).first(k), same,
                               &MapKeyFrame::rig_from_world, &MapKeyFrame::rig_from_world);
  }

  PanelWorld world_{7};
  TrueMap truth_ = true_map(world_, 10);
  OdometryOptions options_;
  Mapper mapper_{truth_.rig, options_};
};

TEST_F(AdjustingTest, AKeyFrameThatMayWaitIsAdjustedWithTheNext) {
  EXPECT_FALSE(adds_one(Adjusting::kSoon));
  EXPECT_TRUE(adds_one(Adjusting::kSoon));
  EXPECT_FALSE(adds_one(Adjusting::kSoon));
}

TEST_F(AdjustingTest, AKeyFrameThatTrackingNeedsIsAdjustedAtOnce) {
  EXPECT_TRUE(adds_one(Adjusting::kNow));
}

TEST_F(AdjustingTest, ThePaperAdjustsEveryKeyFrame) {
  options_.paper_window = true;
  EXPECT_TRUE(adds_one(Adjusting::kSoon));
}

// What a change of the calibration leaves to be done: the poses from a key frame on, and all points.
TEST_F(AdjustTest, AnAdaptedPartComesBackWithItsPointsAndTheRestStays) {
  constexpr int kFirst = 5;
  const std::vector<Rigid3> truth = poses();
  for (const Adaption how :
       {Adaption::kThinned, Adaption::kTwoSeriesThinned, Adaption::kTwoSeries, Adaption::kToTheEnd}) {
    truth_.map = ten_keyframes().map;
    disturb_geometry(0.02, 0.003);
    for (int k = 0; k < kFirst; ++k) truth_.map.keyframes[k].rig_from_world = truth[k];
    const double before = rms();
    ASSERT_GT(before, 1.0) << "the test disturbs nothing";
    Mapper mapper(truth_.rig, options_);
    mapper.adapt_to_cameras(kFirst, how, &truth_.map);
    EXPECT_LT(rms(), 0.15 * before);  // but for the few points that only the others see
    const std::vector<Rigid3> found = poses();
    for (int k = 0; k < kFirst; ++k) EXPECT_TRUE(same(found[k], truth[k])) << k;
    for (int k = kFirst; k < 10; ++k)
      EXPECT_LT(degrees_between(found[k].rotation, truth[k].rotation), 0.01) << k;
  }
}

// Patches that slide the same way, by less than makes an outlier, bend the path by a loss that suits what an
// inlier may be, and hardly by one that suits the noise.
TEST(AdjustToNoise, MatchesThatAreWrongByLittleBendNothing) {
  test::LongDrive drive = test::long_drive({.keyframes = 120, .round = 600, .points = 120, .noise_px = 0.1});
  Rng rng(2);
  for (const Track& t : drive.map.tracks) {
    if (rng.uniform() > 0.1) continue;
    for (size_t i = 0; i < t.observations.size() && t.observations[i].keyframe < 60; ++i) {
      const TrackObservation& o = t.observations[i];
      Eigen::Vector2f& pixel = drive.map.keyframes[o.keyframe].pixels[o.feature];
      pixel += 0.4f * static_cast<float>(i) * (pixel - Eigen::Vector2f(600, 190)).normalized();
    }
  }
  const TrackingRig rig(drive.rig);
  const OdometryOptions options;
  Mapper mapper(rig, options);
  mapper.adapt_to_cameras(0, Adaption::kToTheEnd, &drive.map);
  const double before = test::position_error(drive);
  mapper.adjust_to_noise(&drive.map);
  EXPECT_LT(test::position_error(drive), 0.3 * before);
}

TEST(StartTracks, KeepTheirDistanceFromWhatIsThere) {
  const ViewPtr view = film(PanelWorld(7), testing_support::small_camera(), Rigid3{}, 0);
  ASSERT_GT(view->cameras[0].features.size(), 200);
  Map map;
  map.keyframes.emplace_back();
  map.tracks.emplace_back();
  map.observe(0, 0, map.keyframes[0].add(0, {160, 120}, 0, 0));
  start_tracks(TrackingRig(Rig{{testing_support::small_camera()}}), *view, 30, 0, &map);
  const Features& corners = view->cameras[0].features;
  int near = 0;
  for (int i = 0; i < corners.size(); ++i) {
    near += (corners.pixels[i] - Eigen::Vector2f(160, 120)).norm() < 30 * octave_side(corners.octaves[i]);
  }
  ASSERT_GT(near, 5);
  EXPECT_EQ(map.keyframes[0].size(), 1 + corners.size() - near);
  EXPECT_EQ(map.tracks.size(), map.keyframes[0].tracks.size());
  for (size_t t = 1; t < map.tracks.size(); ++t) {
    EXPECT_FALSE(map.tracks[t].triangulated);
    EXPECT_GE((map.keyframes[0].pixels[t] - Eigen::Vector2f(160, 120)).norm(),
              30 * octave_side(map.keyframes[0].octaves[t]));
  }
}

}  // namespace
}  // namespace raysfm
