#include "raysfm/places/place_matcher.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <set>

#include "raysfm/core/random.h"
#include "raysfm/places/world_relation.h"
#include "support/described_map.h"

namespace raysfm {
namespace {

using testing_support::degrees_between;
using testing_support::described_map;
using testing_support::film;
using testing_support::PanelWorld;
using testing_support::true_pose;
using testing_support::TrueMap;

class PlaceMatcherTest : public testing::Test {
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
  DescribedCorners corners_from(const Rigid3& rig_from_world, uint64_t seed = 7) {
    return describe_corners(*view_from(rig_from_world, seed), describer_);
  }
  // Matches within three pixels of where the pose sees the tracks.
  int right(const RecognisedPlace& place, const DescribedCorners& seen, const Rigid3& rig_from_world) const {
    int count = 0;
    for (const CornerOfTrack& m : place.matches) {
      Eigen::Vector2d pixel;
      const Eigen::Vector3d point =
          truth_.rig.cam_from_rig(0) * (rig_from_world * truth_.map.tracks[m.track].position);
      count += truth_.rig.find(0, point, &pixel) &&
               (pixel - seen.corners[m.corner].pixel.cast<double>()).norm() < 3;
    }
    return count;
  }
  TrackEnd end_at(int keyframe) {
    const MapKeyFrame& k = truth_.map.keyframes[keyframe];
    DescribedCorners last;
    for (int f = 0; f < k.size(); ++f)
      last.corners.push_back({k.tracks[f], k.cameras[f], k.octaves[f], k.pixels[f]});
    describe_upright(*truth_.views[keyframe].view, describer_, &last);
    return {0, keyframe, last.corners, last.upright};
  }
  std::optional<RecognisedPlace> recognise(const DescribedCorners& seen, int keyframe = 1) {
    return matcher_.recognise(seen, truth_.map, keyframe, 1, 2);
  }

  TrueMap truth_ = described_map(PanelWorld(7), 3);
  PlaceMatcher matcher_{truth_.rig};
  Describer describer_;
};

void expect_pose(const RecognisedPlace& place, const Rigid3& truth, double metres, double degrees) {
  const Rigid3 off = place.rig_from_world * truth.inverse();
  EXPECT_LT((place.rig_from_world.inverse().translation - truth.inverse().translation).norm(), metres);
  EXPECT_LT(degrees_between(place.rig_from_world.rotation, truth.rotation), degrees);
  // What it says of its own error, in standard deviations.
  const double squared =
      off.translation.dot(place.covariance.topLeftCorner<3, 3>().ldlt().solve(off.translation));
  EXPECT_GT(place.covariance.diagonal().minCoeff(), 0);
  EXPECT_LT(std::sqrt(squared), 8);
}

TEST_F(PlaceMatcherTest, KnowsAPlaceHoweverTheCameraIsTurned) {
  for (const double angle : {0.0, 0.7, 1.6, 3.14}) {
    const Rigid3 pose = turned(2.5, angle);
    const DescribedCorners seen = corners_from(pose);
    const std::optional<RecognisedPlace> place = recognise(seen);
    ASSERT_TRUE(place) << angle;
    EXPECT_EQ(place->keyframe, 1);
    expect_pose(*place, pose, 0.02, 0.3);
    EXPECT_GT(right(*place, seen, pose), 60) << angle;
    EXPECT_GT(right(*place, seen, pose), 0.9 * static_cast<double>(place->matches.size())) << angle;
    EXPECT_LT(place->log10_false_alarms, -40) << angle;
    std::set<int> corners, tracks;
    for (const CornerOfTrack& m : place->matches) {
      EXPECT_TRUE(corners.insert(m.corner).second);
      EXPECT_TRUE(tracks.insert(m.track).second);
    }
  }
}

// As where a poster hangs in another room too.
TEST_F(PlaceMatcherTest, TellsHowMuchOfAnEndIsThere) {
  const TrackEnd end = end_at(1);
  const ViewPtr here = view_from(true_pose(truth_.rig, 1.3)),
                elsewhere = view_from(true_pose(truth_.rig, 1.3), 8);
  DescribedCorners seen = describe_corners(*here, describer_),
                   other = describe_corners(*elsewhere, describer_);
  describe_upright(*here, describer_, &seen);
  describe_upright(*elsewhere, describer_, &other);
  const auto width = static_cast<float>(truth_.rig.camera(0).width);
  for (const float part : {1.0f, 0.6f, 0.3f}) {
    DescribedCorners mixed;
    const auto take = [&](const DescribedCorners& from, bool left) {
      for (size_t i = 0; i < from.corners.size(); ++i) {
        if ((from.corners[i].pixel.x() < part * width) != left) continue;
        mixed.corners.push_back(from.corners[i]);
        mixed.descriptors.push_back(from.descriptors[i]);
        mixed.upright.push_back(from.upright[i]);
      }
    };
    take(seen, true);
    take(other, false);
    const auto place = matcher_.recognise(mixed, truth_.map, end, 1, 2);
    ASSERT_TRUE(place) << part;
    EXPECT_GT(place->found, 0.7 * part);
    EXPECT_LT(place->found, 0.9 * part);
  }
}

// From far aside, by what is upright, where what turns with the picture tells too little.
TEST_F(PlaceMatcherTest, KnowsWhereTrackEndedFromAside) {
  const Rigid3 here = true_pose(truth_.rig, 1);
  const Eigen::Vector3d middle(0, 0, 4.5);
  const auto aside = [&](double angle) {
    const Eigen::Quaterniond turn = exp_so3({0, angle, 0});
    return here * Rigid3{turn, middle - turn * middle};
  };
  const TrackEnd end = end_at(1);
  int by_turning = 0, by_upright = 0;
  for (const double angle : {-0.8, -0.7, -0.6, 0.6, 0.7, 0.8}) {
    const ViewPtr view = view_from(aside(angle));
    DescribedCorners seen = describe_corners(*view, describer_);
    describe_upright(*view, describer_, &seen);
    const auto significant = [](const std::optional<RecognisedPlace>& p) {
      return p && p->log10_false_alarms < -20;
    };
    by_turning += significant(recognise(seen));
    const auto place = matcher_.recognise(seen, truth_.map, end, 1, 2);
    if (!significant(place)) continue;
    ++by_upright;
    EXPECT_EQ(place->keyframe, 1);
    expect_pose(*place, aside(angle), 0.1, 1);
    EXPECT_GT(right(*place, seen, aside(angle)), 0.9 * static_cast<double>(place->matches.size()));
  }
  EXPECT_GE(by_upright, 5);
  EXPECT_LE(by_turning, 2);
}

// The rays of the same camera instead of its pixels.
TEST_F(PlaceMatcherTest, KnowsAPlaceByAngles) {
  const TrackingRig angular(truth_.rig.rig(), ErrorMeasure::kAngular);
  ASSERT_TRUE(angular.angular());
  const Rigid3 pose = turned(2.5, 0.7);
  const DescribedCorners seen = corners_from(pose);
  const auto place = PlaceMatcher(angular).recognise(seen, truth_.map, 1, 1, 2);
  ASSERT_TRUE(place);
  expect_pose(*place, pose, 0.02, 0.3);
  EXPECT_GT(right(*place, seen, pose), 60);
}

// Two cameras back to back: the second sees the place now.
TEST_F(PlaceMatcherTest, AnyCameraOfTheRigMaySeeThePlace) {
  Rig two = truth_.rig.rig();
  two.cameras.push_back(two.cameras[0]);
  const Rigid3 half_turn{exp_so3({0, std::numbers::pi, 0}), {0.02, 0, -0.1}};
  two.cameras[1].rig_from_cam = two.cameras[0].rig_from_cam * half_turn;
  const TrackingRig rig(two);
  const Rigid3 camera_pose = turned(2, 0.2);
  DescribedCorners seen = corners_from(camera_pose);
  for (TrackPixel& corner : seen.corners) corner.camera = 1;
  const auto place = PlaceMatcher(rig).recognise(seen, truth_.map, 1, 1, 2);
  ASSERT_TRUE(place);
  // Camera 1 is where camera 0 of the rig of one was.
  const Rigid3 expected = two.cameras[1].rig_from_cam * two.cameras[0].rig_from_cam.inverse() * camera_pose;
  expect_pose(*place, expected, 0.03, 0.3);
}

TEST_F(PlaceMatcherTest, TheSameCallsGiveTheSame) {
  const DescribedCorners seen = corners_from(turned(2, 0.4)), others = corners_from(turned(0, 0), 50);
  const auto first = recognise(seen);
  recognise(others);
  const auto again = recognise(seen), fresh = PlaceMatcher(truth_.rig).recognise(seen, truth_.map, 1, 1, 2);
  ASSERT_TRUE(first && again && fresh);
  for (const auto& other : {*again, *fresh}) {
    EXPECT_EQ(other.rig_from_world.translation, first->rig_from_world.translation);
    EXPECT_EQ(other.rig_from_world.rotation.coeffs(), first->rig_from_world.rotation.coeffs());
    EXPECT_EQ(other.log10_false_alarms, first->log10_false_alarms);
    EXPECT_EQ(other.matches.size(), first->matches.size());
  }
}

TEST_F(PlaceMatcherTest, TracksWithoutAPositionAreLeftOut) {
  const DescribedCorners seen = corners_from(turned(1, 0));
  ASSERT_TRUE(recognise(seen));
  for (size_t t = 0; t < truth_.map.tracks.size(); t += 2) truth_.map.tracks[t].triangulated = false;
  const auto place = recognise(seen);
  ASSERT_TRUE(place);
  for (const CornerOfTrack& m : place->matches) EXPECT_EQ(m.track % 2, 1);
  for (int& track : truth_.map.keyframes[1].tracks) track = -1;
  EXPECT_FALSE(recognise(seen));
}

// Corners that say that the camera is here, and others that say that it is there: a place that repeats
// itself.
TEST_F(PlaceMatcherTest, NothingIsKnownWhereAnotherPoseExplainsNearlyAsMuch) {
  const DescribedCorners seen = described_corners(truth_.map.keyframes[1]);
  const Rigid3 there = true_pose(truth_.rig, 2) * truth_.map.keyframes[0].rig_from_world.inverse() *
                       truth_.map.keyframes[1].rig_from_world;
  for (const int every : {2, 20}) {
    DescribedCorners both = seen;
    for (size_t i = 0; i < both.corners.size(); i += every) {
      TrackPixel& corner = both.corners[i];
      Eigen::Vector2d pixel;
      const Eigen::Vector3d point =
          truth_.rig.cam_from_rig(corner.camera) * (there * truth_.map.tracks[corner.track].position);
      if (truth_.rig.find(corner.camera, point, &pixel)) corner.pixel = pixel.cast<float>();
    }
    EXPECT_EQ(recognise(both).has_value(), every == 20) << every;
  }
}

TEST_F(PlaceMatcherTest, NothingIsKnownOfNothing) {
  EXPECT_FALSE(recognise({}));
  const DescribedCorners seen = corners_from(turned(1, 0));
  truth_.map.keyframes[1].described.clear();
  truth_.map.keyframes[1].descriptors.clear();
  EXPECT_FALSE(recognise(seen));
}

// Points of key frames beside that of the place are found too.
TEST_F(PlaceMatcherTest, PointsOfTheKeyFramesBesideItAreFound) {
  const DescribedCorners seen = corners_from(turned(2, 0));
  const auto all = recognise(seen);
  ASSERT_TRUE(all);
  // Half of what key frame 1 is known by.
  MapKeyFrame& k = truth_.map.keyframes[1];
  k.described.resize(k.described.size() / 2);
  k.descriptors.resize(k.described.size());
  const auto half = recognise(seen);
  ASSERT_TRUE(half);
  EXPECT_GT(half->matches.size(), 0.8 * static_cast<double>(all->matches.size()));
  for (const int beside : {0, 2}) truth_.map.keyframes[beside].described.clear();
  const auto alone = recognise(seen);
  ASSERT_TRUE(alone);
  EXPECT_LT(alone->matches.size(), 0.7 * static_cast<double>(all->matches.size()));
}

// So many bits of a descriptor turned round, from one on.
Descriptor changed(Descriptor d, int from, int bits) {
  for (int b = from; b < from + bits; ++b) d.bits[b / 64 % 4] ^= uint64_t{1} << (b % 64);
  return d;
}

// Each corner stands twice in the view, once where it belongs and once elsewhere: only where the right one
// looks clearly more like the point is anything known.
TEST_F(PlaceMatcherTest, CornersThatLookNearlyAlikeSayNothing) {
  const DescribedCorners seen = described_corners(truth_.map.keyframes[1]);
  for (const int differing : {22, 60}) {
    DescribedCorners twice;
    for (size_t i = 0; i < seen.corners.size(); ++i) {
      twice.corners.push_back(seen.corners[i]);
      twice.descriptors.push_back(changed(seen.descriptors[i], 0, 20));
      twice.corners.push_back(seen.corners[seen.corners.size() - 1 - i]);
      twice.descriptors.push_back(changed(seen.descriptors[i], 64, differing));
    }
    EXPECT_EQ(recognise(twice).has_value(), differing == 60) << differing;
  }
}

// Where a pose sees a point is a corner, but one of something else.
TEST_F(PlaceMatcherTest, CornersThatLookOtherwiseAreNotThePoint) {
  DescribedCorners seen = described_corners(truth_.map.keyframes[1]);
  for (size_t i = 0; i < seen.corners.size(); i += 3) {
    seen.descriptors[i] = changed(seen.descriptors[i], static_cast<int>(i), 120);
  }
  const auto place = recognise(seen);
  ASSERT_TRUE(place);
  ASSERT_GT(place->matches.size(), 60u);
  for (const CornerOfTrack& m : place->matches) EXPECT_NE(m.corner % 3, 0);
}

// False alarms where every corner is matched and agrees, as place_matcher.h has them: a wrong match agrees
// with a pose where it falls within four pixels of the octave, ten times as often as dots would, and what
// agrees within one of 24 x 24 * height / width cells of one camera's image is one match.
double false_alarms(const DescribedCorners& seen, const TrackingRig& rig) {
  std::set<std::array<int, 3>> cells;
  double chance = 0;
  for (const TrackPixel& corner : seen.corners) {
    const Camera& camera = rig.camera(corner.camera);
    const float side = static_cast<float>(camera.width) / 24;
    cells.insert({corner.camera, static_cast<int>(corner.pixel.x() / side),
                  static_cast<int>(corner.pixel.y() / side)});
    chance +=
        10 * std::numbers::pi * std::pow(4 * octave_side(corner.octave), 2) / camera.width / camera.height;
  }
  const auto count = static_cast<int>(seen.corners.size());
  return log10_chance_poses(count, static_cast<int>(cells.size()), std::min(0.5, chance / count));
}

TEST_F(PlaceMatcherTest, FalseAlarmsAreThoseOfTheCellsOfTheImage) {
  const DescribedCorners seen = described_corners(truth_.map.keyframes[1]);
  const auto place = recognise(seen);
  ASSERT_TRUE(place);
  EXPECT_NEAR(place->log10_false_alarms, false_alarms(seen, truth_.rig), 1e-6);
}

// A second camera that sees the same as the first, in the other direction.
TEST_F(PlaceMatcherTest, CellsOfTwoCamerasAreTwoCells) {
  Rig two = truth_.rig.rig();
  two.cameras.push_back(two.cameras[0]);
  two.cameras[1].rig_from_cam =
      two.cameras[0].rig_from_cam * Rigid3{exp_so3({0, std::numbers::pi, 0}), {0, 0, 0}};
  const TrackingRig rig(two);
  Map& map = truth_.map;
  MapKeyFrame& k = map.keyframes[1];
  const Rigid3 other_from_one = k.rig_from_world.inverse() * two.cameras[1].rig_from_cam *
                                two.cameras[0].rig_from_cam.inverse() * k.rig_from_world;
  const size_t described = k.described.size();
  for (size_t i = 0; i < described; ++i) {
    const int f = k.described[i], track = map.new_track();
    map.tracks[track].position = other_from_one * map.tracks[k.tracks[f]].position;
    map.tracks[track].triangulated = true;
    const int feature = k.add(1, k.pixels[f], k.octaves[f], track);
    map.observe(track, 1, feature);
    k.described.push_back(feature);
    k.descriptors.push_back(changed(k.descriptors[i], 0, 128));
  }
  const DescribedCorners seen = described_corners(k);
  ASSERT_EQ(seen.corners.size(), 2 * described);
  const auto place = PlaceMatcher(rig).recognise(seen, map, 1, 1, 2);
  ASSERT_TRUE(place);
  EXPECT_NEAR(place->log10_false_alarms, false_alarms(seen, rig), 1e-6);
}

double choose(int n, int k) {
  return std::round(std::exp(std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0)));
}

// Triples of `matches` that agree with `agreeing` in all, the others each with a probability: drawn.
double mean_agreeing_poses(int matches, int agreeing, double chance, int trials) {
  Rng rng(3);
  double sum = 0;
  const int triples = static_cast<int>(choose(matches, 3));
  for (int trial = 0; trial < trials; ++trial) {
    for (int triple = 0; triple < triples; ++triple) {
      int agree = 3;
      for (int i = 3; i < matches; ++i) agree += rng.uniform() < chance;
      sum += agree >= agreeing;
    }
  }
  return sum / trials;
}

TEST(ChancePoses, AreNotMoreThanSaid) {
  for (const int matches : {12, 20}) {
    for (const double chance : {0.05, 0.2}) {
      for (const int agreeing : {4, 5, 6, 7}) {
        const double said = std::pow(10, log10_chance_poses(matches, agreeing, chance));
        const double drawn = mean_agreeing_poses(matches, agreeing, chance, 200);
        EXPECT_LT(drawn, said) << matches << " " << chance << " " << agreeing;
        // Nor far fewer: all numbers of matches share one false alarm, and more may agree than are asked for.
        EXPECT_GT(drawn * matches * std::pow(1 - chance, agreeing - matches) * 1.3, said);
      }
    }
  }
}

TEST(ChancePoses, AgreeWithTheFormulaWhereThatCanBeWrittenOut) {
  EXPECT_NEAR(log10_chance_poses(30, 12, 0.02),
              std::log10(30 * choose(30, 12) * choose(12, 3) * std::pow(0.02, 9)), 1e-9);
  // A triple agrees with itself.
  EXPECT_EQ(log10_chance_poses(30, 3, 1e-9), 0);
  EXPECT_EQ(log10_chance_poses(0, 0, 0.1), 0);
  EXPECT_LT(log10_chance_poses(600, 600, 1e-3), -1000);
}

}  // namespace
}  // namespace raysfm
