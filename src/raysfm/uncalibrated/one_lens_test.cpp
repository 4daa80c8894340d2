#include "raysfm/uncalibrated/one_lens.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

constexpr double kFocal = 500;
constexpr int kImages = 14, kPoints = 600;

// A camera that walks past points and turns.
struct Footage {
  UncalibratedScene truth;
  PointTracks tracks;
  std::vector<uint8_t> used;
};

// Pixels without errors.
Footage film(const RadialDistortion& radial) {
  Rng rng(5);
  Footage footage;
  for (int i = 0; i < kPoints; ++i) {
    footage.truth.points.emplace_back(rng.uniform(-6, 14), rng.uniform(-5, 5), rng.uniform(6, 14));
  }
  PointTracks& tracks = footage.tracks;
  tracks.image_count = kImages;
  tracks.point_count = kPoints;
  tracks.image_size = {640, 480};
  for (int j = 0; j < kImages; ++j) {
    const double s = double(j) / (kImages - 1);
    const Eigen::Quaterniond rotation =
        exp_so3({0.15 * std::sin(9 * s), 0.25 * std::sin(7 * s), 0.2 * std::sin(11 * s)});
    const Eigen::Vector3d centre(8 * s, 0.8 * std::sin(8 * s), 1.5 * std::sin(10 * s));
    footage.truth.cam_from_world.push_back({rotation, -(rotation * centre)});
    footage.truth.lenses.push_back({kFocal, kFocal, 319.5, 239.5, 0});
    for (int i = 0; i < kPoints; ++i) {
      const Eigen::Vector3d x = footage.truth.cam_from_world[j] * footage.truth.points[i];
      if (!(x.z() > 1) || x.hnormalized().norm() > 1) continue;
      const Eigen::Vector2d p = footage.truth.lenses[j].pixel(radial(x.hnormalized()));
      if (p.x() > 0 && p.y() > 0 && p.x() < 639 && p.y() < 479) tracks.add(j, i, p);
    }
  }
  footage.used.assign(tracks.size(), 1);
  return footage;
}

Eigen::Vector2d noise(double sigma, Rng* rng) {
  return sigma * Eigen::Vector2d(rng->normal(), rng->normal());
}

void add_pixel_noise(double sigma, Rng* rng, PointTracks* tracks) {
  for (Eigen::Vector2d& p : tracks->pixel) p += noise(sigma, rng);
}

// Each track strays farther and farther, as a corner does that is followed from image to image.
void add_drift(double step, Rng* rng, PointTracks* tracks) {
  std::vector<Eigen::Vector2d> drift(tracks->point_count, Eigen::Vector2d::Zero());
  for (int k = 0; k < tracks->size(); ++k) {
    tracks->pixel[k] += drift[tracks->point[k]] += noise(step, rng);
  }
}

TEST(OneLens, IsFoundWithItsDistortion) {
  const RadialDistortion truth{-0.12, 0.05};
  Footage footage = film(truth);
  Rng rng(7);
  add_pixel_noise(0.02, &rng, &footage.tracks);
  const auto lens = adjust_one_lens_as_told(footage.tracks, footage.used, {}, footage.truth);
  ASSERT_TRUE(lens.ok()) << lens.error().message;
  EXPECT_EQ(lens->terms, 2);
  EXPECT_NEAR(lens->radial.k1, truth.k1, 4 * lens->sigma[5]);
  EXPECT_NEAR(lens->radial.k2, truth.k2, 4 * lens->sigma[6]);
  EXPECT_NEAR(lens->scene.lenses[0].fx, kFocal, 4 * lens->sigma[0]);
  EXPECT_LT(lens->sigma[0], 0.002 * kFocal);
}

TEST(OneLens, ThreadsChangeNoBit) {
  Footage footage = film({-0.1, 0});
  Rng rng(17);
  add_pixel_noise(0.1, &rng, &footage.tracks);
  std::vector<LensNumbers> lenses, sigmas;
  std::vector<Eigen::Vector3d> points;
  for (const int threads : {1, 2, 5}) {
    SolveOptions options;
    options.threads = threads;
    const auto lens = adjust_one_lens_as_told(footage.tracks, footage.used, options, footage.truth);
    ASSERT_TRUE(lens.ok()) << lens.error().message;
    LensNumbers numbers;
    numbers << lens->scene.lenses[0].vector(), lens->radial.k1, lens->radial.k2;
    lenses.push_back(numbers), sigmas.push_back(lens->sigma);
    points.push_back(lens->scene.points.back());
  }
  for (size_t i = 1; i < lenses.size(); ++i) {
    EXPECT_EQ(lenses[i], lenses[0]);
    EXPECT_EQ(sigmas[i], sigmas[0]);
    EXPECT_EQ(points[i], points[0]);
  }
}

// Where a coefficient was left out, the weights begin with the residuals that it leaves: they are right at
// once, and a lens that is far from its own distortion has few good tracks to begin with.
TEST(OneLens, WeightsBeginWithAllOfTheDistortion) {
  const RadialDistortion truth{-0.05, 0.02};
  Footage footage = film(truth);
  Rng rng(19);
  add_pixel_noise(0.1, &rng, &footage.tracks);
  const auto warm = adjust_one_lens(footage.tracks, footage.used, {}, 1, footage.truth, truth);
  const auto cold = adjust_one_lens(footage.tracks, footage.used, {}, 1, footage.truth, {truth.k1, 0});
  ASSERT_TRUE(warm.ok() && cold.ok());
  EXPECT_EQ(warm->radial.k2, 0);
  EXPECT_LT(std::abs(warm->scene.lenses[0].fx - cold->scene.lenses[0].fx), 0.3 * cold->sigma[0]);
  EXPECT_LT(warm->adjustment.lm.iterations, cold->adjustment.lm.iterations);
}

TEST(OneLens, WithoutDistortionIsNotGivenOne) {
  constexpr int kTrials = 20;
  int given = 0;
  for (int t = 0; t < kTrials; ++t) {
    Footage footage = film({});
    Rng rng(100 + t);
    add_pixel_noise(0.1, &rng, &footage.tracks);
    add_drift(0.1, &rng, &footage.tracks);
    const auto lens = adjust_one_lens_as_told(footage.tracks, footage.used, {}, footage.truth);
    ASSERT_TRUE(lens.ok()) << lens.error().message;
    given += !lens->radial.none();
  }
  EXPECT_LE(given, 1);
}

// Errors in units of their standard deviations, root mean square over many footages, for errors that are
// alike along a track; the standard error is 9 %. With those of the normal equations the first is 1.7.
TEST(OneLens, StandardDeviationsAreTheScatterWhereErrorsAreAlikeAlongATrack) {
  constexpr int kTrials = 60;
  const RadialDistortion truth{-0.1, 0};
  double focal = 0, k1 = 0;
  for (int t = 0; t < kTrials; ++t) {
    Footage footage = film(truth);
    Rng rng(200 + t);
    add_drift(0.1, &rng, &footage.tracks);
    const auto lens = adjust_one_lens(footage.tracks, footage.used, {}, 1, footage.truth, truth);
    ASSERT_TRUE(lens.ok()) << lens.error().message;
    focal += std::pow((lens->scene.lenses[0].fx - kFocal) / lens->sigma[0], 2) / kTrials;
    k1 += std::pow((lens->radial.k1 - truth.k1) / lens->sigma[5], 2) / kTrials;
  }
  EXPECT_NEAR(std::sqrt(focal), 1, 0.3);
  EXPECT_NEAR(std::sqrt(k1), 1, 0.3);
}

TEST(OneLens, TracksThatGoWrongAsAWholeWeighLittle) {
  constexpr int kTrials = 12;
  double by_tracks = 0, by_observations = 0;
  for (int t = 0; t < kTrials; ++t) {
    Footage footage = film({});
    Rng rng(300 + t);
    add_pixel_noise(0.1, &rng, &footage.tracks);
    std::vector<double> wrong(kPoints, 0);
    for (double& w : wrong) w = rng.uniform(0, 1) < 0.15 ? 0.8 : 0;
    for (int k = 0; k < footage.tracks.size(); ++k) {
      footage.tracks.pixel[k] += noise(wrong[footage.tracks.point[k]], &rng);
    }
    const auto lens = adjust_one_lens(footage.tracks, footage.used, {}, 2, footage.truth);
    ASSERT_TRUE(lens.ok()) << lens.error().message;
    by_tracks += std::pow(lens->scene.lenses[0].fx - kFocal, 2);
    LensAdjustmentOptions options;
    options.constraints = constraints_for(footage.tracks, {}, true);
    options.loss = {RobustLoss::Kind::kHuber, 1};
    options.radial_terms = 2;
    UncalibratedScene scene = footage.truth;
    ASSERT_TRUE(adjust_standard(footage.tracks, {}, options, &scene).ok());
    by_observations += std::pow(scene.lenses[0].fx - kFocal, 2);
  }
  EXPECT_LT(std::sqrt(by_tracks), 0.6 * std::sqrt(by_observations));
}

// Tracks in one half of the images that are all off the same way: no scatter of tracks tells of it, but those
// of small errors do not agree with the rest.
TEST(OneLens, ErrorsThatAreNoNoiseWidenTheStandardDeviations) {
  const auto widened = [](bool systematic) {
    Footage footage = film({});
    Rng rng(11);
    add_pixel_noise(0.1, &rng, &footage.tracks);
    PointTracks& tracks = footage.tracks;
    for (int k = 0; systematic && k < tracks.size(); ++k) {
      if (tracks.point[k] % 4 == 0) tracks.pixel[k] += 0.01 * (tracks.pixel[k] - tracks.centre());
    }
    auto lens = adjust_one_lens(tracks, footage.used, {}, 1, footage.truth);
    EXPECT_TRUE(lens.ok());
    const double before = lens->sigma[0];
    EXPECT_TRUE(widen_by_other_weights(tracks, footage.used, {}, &*lens).ok());
    return lens->sigma[0] / before;
  };
  EXPECT_LT(widened(false), 1.3);
  EXPECT_GT(widened(true), 2);
}

TEST(OneLens, WhatALeftOutCoefficientWouldChangeIsInTheStandardDeviation) {
  Footage footage = film({});
  Rng rng(13);
  add_pixel_noise(0.2, &rng, &footage.tracks);
  const auto told = adjust_one_lens_as_told(footage.tracks, footage.used, {}, footage.truth);
  const auto free = adjust_one_lens(footage.tracks, footage.used, {}, 1, footage.truth);
  ASSERT_TRUE(told.ok() && free.ok());
  ASSERT_EQ(told->terms, 0);
  const double change = std::abs(told->scene.lenses[0].fx - free->scene.lenses[0].fx);
  EXPECT_GT(change, 0);
  EXPECT_GE(told->sigma[0], 0.99 * change);
}

}  // namespace
}  // namespace raysfm
