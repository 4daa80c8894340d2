#include "raysfm/uncalibrated/lens_choice.h"

#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

constexpr int kChoiceImages = 9, kChoicePoints = 60;

// Images along a line that look at a cloud of points; the pixels are those of lenses of focal length 500.
struct Seen {
  PointTracks tracks;
  UncalibratedReconstruction truth;
};

Seen look() {
  Seen seen;
  Rng rng(3);
  UncalibratedReconstruction& r = seen.truth;
  for (int j = 0; j < kChoiceImages; ++j) {
    r.scene.cam_from_world.push_back({Eigen::Quaterniond::Identity(), {0.2 * j, 0, 0}});
    r.scene.lenses.push_back({500, 500, 320, 240, 0});
  }
  for (int i = 0; i < kChoicePoints; ++i) {
    r.scene.points.emplace_back(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(4, 6));
  }
  seen.tracks.image_count = kChoiceImages;
  seen.tracks.point_count = kChoicePoints;
  seen.tracks.image_size = {640, 480};
  for (int j = 0; j < kChoiceImages; ++j) {
    for (int i = 0; i < kChoicePoints; ++i) {
      const Eigen::Vector3d x = r.scene.cam_from_world[j] * r.scene.points[i];
      seen.tracks.add(j, i, r.scene.lenses[j].pixel(x.hnormalized()));
    }
  }
  r.image_posed.assign(kChoiceImages, 1);
  r.point_placed.assign(kChoicePoints, 1);
  r.inlier.assign(seen.tracks.size(), 1);
  return seen;
}

// The truth with every pixel off by about `error` px, and focal lengths that spread by the share `spread`.
UncalibratedReconstruction with(const UncalibratedReconstruction& truth, double error, double spread,
                                bool zooming) {
  UncalibratedReconstruction r = truth;
  Rng rng(4);
  for (int j = 0; j < kChoiceImages; ++j) {
    const double focal = 500 * (1 + spread * (j % 2 ? 1 : -1));
    r.scene.lenses[j] = {focal, focal, 320, 240, 0};
    r.scene.lenses[j].cx += error;
  }
  r.zooming = zooming;
  return r;
}

bool zooms(double error_fixed, double error_zoom, double spread,
           ErrorRelation errors = ErrorRelation::kAlongTracks) {
  const Seen seen = look();
  // The pixels of lenses that spread: what is left of the error is that of the principal point.
  PointTracks tracks = seen.tracks;
  const UncalibratedReconstruction zoom = with(seen.truth, error_zoom, spread, true);
  UncalibratedReconstruction exact = with(seen.truth, 0, spread, true);
  for (int k = 0; k < tracks.size(); ++k) tracks.pixel[k] += pixel_residual(tracks, exact.scene, {}, k);
  const std::vector<uint8_t> all(kChoiceImages, 1);
  const auto chosen = choose_lens(tracks, all, with(seen.truth, error_fixed, 0, false), zoom, 50, errors);
  EXPECT_TRUE(chosen);
  EXPECT_FALSE(chosen->lens_evidence.empty());
  return chosen->zooming;
}

TEST(LensChoice, ChangeOfTheFocalLengthThatExplainsTheResidualsIsAZoom) {
  EXPECT_TRUE(zooms(0.5, 0.5, 0.05));
  EXPECT_TRUE(zooms(0.5, 0.1, 0.015));
}

TEST(LensChoice, LensThatHardlyChangesIsFixedWhateverTheResidualsSay) {
  EXPECT_FALSE(zooms(1.0, 0.1, 0.006));  // errors that are alike along a track look like this
  EXPECT_FALSE(zooms(0.5, 0.5, 0.0));
}

// A third of the images gains by a lens of its own, whose focal length is that of the one lens; the others'
// change, and gain nothing by it: what they see lies half-way between both.
TEST(LensChoice, ChangeInImagesThatGainNothingByItIsNoZoom) {
  constexpr double kSpread = 0.05, kOff = 8;
  const Seen seen = look();
  const UncalibratedReconstruction fixed = with(seen.truth, 0, 0, false);
  UncalibratedReconstruction zoom = with(seen.truth, 0, kSpread, true);
  PointTracks tracks = seen.tracks;
  for (int k = 0; k < tracks.size(); ++k) {
    const int j = tracks.image[k];
    if (j % 3 == 0) {
      zoom.scene.lenses[j] = {500, 500, 320 + kOff, 240, 0};
      tracks.pixel[k].x() += kOff;
    } else {
      tracks.pixel[k] += 0.5 * pixel_residual(tracks, zoom.scene, {}, k);
    }
  }
  const std::vector<uint8_t> all(kChoiceImages, 1);
  const auto chosen = choose_lens(tracks, all, fixed, zoom, 50, ErrorRelation::kAlongTracks);
  ASSERT_TRUE(chosen);
  EXPECT_FALSE(chosen->zooming) << chosen->lens_evidence;
  EXPECT_LT(chosen->lens_spread, 0.001);  // in those that gain
  EXPECT_GT(chosen->lens_gain, 1.15);     // which was enough
}

// A camera that zoomed in once and for all: the images that gain have one focal length, and the one lens is
// that of the others.
TEST(LensChoice, ImagesThatGainMayAllHaveOneFocalLength) {
  constexpr double kZoomed = 600;
  const Seen seen = look();
  const UncalibratedReconstruction fixed = with(seen.truth, 0, 0, false);
  UncalibratedReconstruction zoom = fixed;
  zoom.zooming = true;
  PointTracks tracks = seen.tracks;
  std::vector<double> focals(kChoiceImages, 500);
  for (int j = kChoiceImages - kChoiceImages / 3; j < kChoiceImages; ++j) focals[j] = kZoomed;
  for (int j = 0; j < kChoiceImages; ++j) zoom.scene.lenses[j] = {focals[j], focals[j], 320, 240, 0};
  for (int k = 0; k < tracks.size(); ++k) tracks.pixel[k] += pixel_residual(tracks, zoom.scene, {}, k);
  const std::vector<uint8_t> all(kChoiceImages, 1);
  const auto chosen = choose_lens(tracks, all, fixed, zoom, 50, ErrorRelation::kAlongTracks);
  ASSERT_TRUE(chosen);
  EXPECT_TRUE(chosen->zooming) << chosen->lens_evidence;
  EXPECT_NEAR(chosen->lens_spread, std::log(kZoomed / 500), 0.01);
}

// Of photos, so many have another focal length, and residuals that it explains.
bool photos_zoom(int photos) {
  constexpr double kSpread = 0.3, kNoise = 1.0;
  const Seen seen = look();
  const UncalibratedReconstruction fixed = with(seen.truth, 0, 0, false);
  UncalibratedReconstruction zoom = fixed;
  zoom.zooming = true;
  for (int j = 0; j < photos; ++j)
    zoom.scene.lenses[j] = {500 * (1 + kSpread), 500 * (1 + kSpread), 320, 240, 0};
  PointTracks tracks = seen.tracks;
  Rng rng(6);
  for (int k = 0; k < tracks.size(); ++k) {
    tracks.pixel[k] += pixel_residual(tracks, zoom.scene, {}, k);
    tracks.pixel[k] += kNoise * Eigen::Vector2d(rng.normal(), rng.normal());
  }
  const std::vector<uint8_t> all(kChoiceImages, 1);
  const auto chosen = choose_lens(tracks, all, fixed, zoom, 50, ErrorRelation::kWithinImages);
  EXPECT_TRUE(chosen);
  EXPECT_GT(chosen->lens_gain, 2);
  EXPECT_GT(chosen->lens_spread, 0.03);
  return chosen->zooming;
}

TEST(LensChoice, AFewPhotosInWrongPlacesAreNoZoom) {
  EXPECT_FALSE(photos_zoom(2));
  EXPECT_TRUE(photos_zoom(6));
}

TEST(LensChoice, ErrorsOfTheirOwnTellSmallChangesToo) {
  EXPECT_TRUE(zooms(1.0, 0.1, 0.006, ErrorRelation::kNone));
  EXPECT_FALSE(zooms(0.5, 0.5, 0.0, ErrorRelation::kNone));
}

TEST(LensChoice, OnlySolutionIsTaken) {
  const Seen seen = look();
  const std::vector<uint8_t> all(kChoiceImages, 1);
  const Result<UncalibratedReconstruction> none = no_reconstruction("none"),
                                           other = no_reconstruction("other");
  const auto fixed = with(seen.truth, 1, 0, false), zoom = with(seen.truth, 9, 0.1, true);
  EXPECT_FALSE(choose_lens(seen.tracks, all, fixed, other, 3, ErrorRelation::kNone)->zooming);
  EXPECT_TRUE(choose_lens(seen.tracks, all, none, zoom, 3, ErrorRelation::kNone)->zooming);
  const auto neither = choose_lens(seen.tracks, all, none, other, 3, ErrorRelation::kNone);
  ASSERT_FALSE(neither);
  EXPECT_EQ(neither.error().message, "none");
}

}  // namespace
}  // namespace raysfm
