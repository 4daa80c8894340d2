#include "raysfm/zoom/zoom_curve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

constexpr int kCurveFrames = 200;

// A zoom by two from frame 60 to frame 140, and one by `jump` at frame 150.
double log_focal(int frame, double jump = 1) {
  const double part = std::clamp((frame - 60) / 80.0, 0.0, 1.0);
  return std::log(500) + std::log(2) * part * part * (3 - 2 * part) + (frame >= 150 ? std::log(jump) : 0);
}

std::vector<FocalMeasurement> rough_values(double noise, double jump = 1) {
  Rng rng(5);
  std::vector<FocalMeasurement> values;
  for (int f = 0; f < kCurveFrames; ++f) values.push_back({f, log_focal(f, jump) + noise * rng.normal(), 1});
  return values;
}

double worst(const std::vector<double>& values, double jump = 1) {
  double most = 0;
  for (int f = 0; f < kCurveFrames; ++f) most = std::max(most, std::abs(values[f] - log_focal(f, jump)));
  return most;
}

TEST(ZoomCurve, RoughValuesAreSmoothed) {
  const auto rough = rough_values(0.01);
  double noise = 0;
  for (const FocalMeasurement& m : rough) noise = std::max(noise, std::abs(m.log_focal - log_focal(m.frame)));
  EXPECT_LT(worst(ZoomCurve(kCurveFrames, rough).log_focals({})), 0.4 * noise);
}

TEST(ZoomCurve, AbsurdAndMissingValuesAreFilledIn) {
  auto rough = rough_values(0.003);
  for (int f = 90; f < 95; ++f) rough[f].log_focal += 0.5;
  for (int f = 20; f < 34; ++f) rough[f].log_focal = 11;
  rough.erase(rough.begin() + 100, rough.begin() + 104);
  EXPECT_LT(worst(ZoomCurve(kCurveFrames, rough).log_focals({})), 0.02);
}

TEST(ZoomCurve, AJumpStaysOne) {
  const std::vector<double> values = ZoomCurve(kCurveFrames, rough_values(0.003, 1.3)).log_focals({});
  EXPECT_LT(worst(values, 1.3), 0.01);
}

TEST(ZoomCurve, WhatWasMeasuredBetterCorrectsWhatIsCommon) {
  auto rough = rough_values(0.004);
  for (FocalMeasurement& m : rough) m.log_focal += 0.08 + 0.0005 * m.frame;
  std::vector<FocalMeasurement> measured;
  Rng rng(6);
  for (int f = 4; f < kCurveFrames; f += 12)
    measured.push_back({f, log_focal(f) + 0.0005 * rng.normal(), 0.001});
  const ZoomCurve curve(kCurveFrames, rough);
  EXPECT_GT(worst(curve.log_focals({})), 0.1);
  EXPECT_LT(worst(curve.log_focals(measured)), 0.004);
}

TEST(ZoomCurve, TheCanvasHoldsTheWidestFrame) {
  const std::vector<double> zoom = {std::log(500), std::log(600), std::log(700)};
  const UndoneZoom undone = undo_zoom(zoom, 640, 480);
  EXPECT_NEAR(undone.focal, 700, 1e-9);
  EXPECT_NEAR(undone.width, 896, 1);
  EXPECT_NEAR(undone.height, 672, 1);
  const std::vector<double> wide = {std::log(500), std::log(3000)};
  const UndoneZoom bounded = undo_zoom(wide, 640, 480);
  EXPECT_NEAR(bounded.focal, 1000, 1e-9);
  EXPECT_LE(bounded.width, 1281);
}

}  // namespace
}  // namespace raysfm
