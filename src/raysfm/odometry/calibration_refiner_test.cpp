// Calibrations that are wrong on purpose, on rendered images whose lens is exact.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <map>
#include <random>
#include <string>

#include "raysfm/eval/trajectory_error.h"
#include "raysfm/odometry/odometry.h"
#include "raysfm/views/rolling_shutter.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::as_view;
using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

struct Heard : TrackerObserver {
  std::vector<CalibrationRefined> refined;
  void calibration_refined(const CalibrationRefined& e) override { refined.push_back(e); }
};

struct Tracked {
  Reconstruction result;
  Heard heard;
  double percent = NAN;  // mean error of the positions, of the path

  const CalibrationNumber& number(std::string_view name) const {
    for (const CalibrationNumber& n : result.calibration) {
      if (n.name == name) return n;
    }
    static const CalibrationNumber none;
    ADD_FAILURE() << name << " is not looked at";
    return none;
  }
};

void track(const SynthViews& views, const Camera& camera, LensRefinement how, Tracked* run) {
  Odometry odometry({{camera}}, {.refine_lens = how}, &run->heard);
  for (int i = 0; i < views.size(); ++i) odometry.process(views.view(i, i));
  run->result = odometry.finish(false);
  Trajectory estimate, truth;
  for (int i = 0; i < views.size(); ++i) {
    truth.timestamps.push_back(i);
    truth.world_from_cam.push_back(views.world_from_rig[i]);
    if (!run->result.frames[i].world_from_rig) continue;
    estimate.timestamps.push_back(i);
    estimate.world_from_cam.push_back(*run->result.frames[i].world_from_rig);
  }
  const auto error = evaluate(estimate, truth, {.alignment = Alignment::kSim3});
  ASSERT_TRUE(error) << error.error().message;
  run->percent = error->percent_of_path();
}

Camera with_focal(double factor) {
  Camera camera = small_camera();
  auto& lens = std::get<Radtan>(camera.model);
  lens.fx *= factor, lens.fy *= factor;
  return camera;
}

const SynthViews& orbit() {
  static const SynthViews views = synth_views("room", "orbit", 120);
  return views;
}

// A camera that turns about what it looks at tells its focal length.
TEST(CalibrationRefiner, AWrongFocalLengthIsFoundAndTheErrorGoes) {
  const Camera exact = small_camera(), wrong = with_focal(1.03);
  Tracked right, kept, refined;
  track(orbit(), exact, LensRefinement::kOff, &right);
  track(orbit(), wrong, LensRefinement::kOff, &kept);
  track(orbit(), wrong, LensRefinement::kAuto, &refined);
  EXPECT_TRUE(kept.result.calibration.empty());
  EXPECT_TRUE(kept.heard.refined.empty());
  ASSERT_FALSE(refined.heard.refined.empty());
  const double truth = std::get<Radtan>(exact.model).fx;
  const CalibrationNumber& fx = refined.number("fx");
  EXPECT_TRUE(fx.told);
  EXPECT_NEAR(fx.given, 1.03 * truth, 1e-9);
  EXPECT_NEAR(fx.refined, truth, 0.006 * truth);
  EXPECT_LT(std::abs(fx.refined - truth), 3 * fx.sigma);
  EXPECT_GT(fx.significance, 4);
  EXPECT_EQ(std::get<Radtan>(refined.result.rig.cameras[0].model).fx, fx.refined);
  EXPECT_LT(refined.percent, 1.3 * right.percent + 0.02);
  EXPECT_GT(kept.percent, 2 * refined.percent);
}

// As of an action camera: its rim is drawn in by a tenth, and guesses of it are off by up to 1.8.
TEST(CalibrationRefiner, ARoughGuessEndsAtTheLens) {
  Camera exact = small_camera();
  auto& lens = std::get<Radtan>(exact.model);
  lens.k1 = -0.2;
  lens.k2 = 0.04;
  const SynthViews views = synth_views("room", "orbit", 120, 0, 0, exact);
  for (const double factor : {0.87, 1.5, 1.8}) {
    Odometry odometry({{with_focal(factor)}},
                      {.calibration_prior = {.focal = 0.2, .centre = 0.02, .rim = 0.2, .is_guess = true}});
    for (int i = 0; i < views.size(); ++i) odometry.process(views.view(i, i));
    odometry.finish(false);
    const auto& found = std::get<Radtan>(odometry.rig().rig().cameras[0].model);
    EXPECT_NEAR(found.fx / lens.fx, 1, 0.02) << factor;
    EXPECT_NEAR(found.k1, lens.k1, 0.02) << factor;
  }
}

TEST(CalibrationRefiner, AnExactCalibrationStays) {
  Tracked run;
  track(orbit(), small_camera(), LensRefinement::kAuto, &run);
  EXPECT_TRUE(run.heard.refined.empty());
  ASSERT_FALSE(run.result.calibration.empty());
  for (const CalibrationNumber& n : run.result.calibration) EXPECT_EQ(n.given, n.refined) << n.name;
}

// Of noisy_map(), whose key frames are a second apart.
Rigid3 turning_pose(double time) {
  return {exp_so3({0.1 * std::sin(0.7 * time), 0.05 * time - 0.6, 0}), {0, 0, 5}};
}

// The first poses, too, moved with what became known of the calibration late.
TEST(CalibrationRefiner, CovariancesHaveItInThemFromTheFirstFrameOn) {
  Tracked refined, exact;
  track(orbit(), small_camera(), LensRefinement::kAuto, &refined);
  track(orbit(), small_camera(), LensRefinement::kOff, &exact);
  ASSERT_TRUE(refined.number("fx").told);
  double ratio = 0;
  for (int i = 0; i < orbit().size(); ++i) {
    const PosedFrame &a = refined.result.frames[i], &b = exact.result.frames[i];
    ASSERT_TRUE(a.world_from_rig && b.world_from_rig);
    EXPECT_EQ(a.world_from_rig->translation, b.world_from_rig->translation) << "it is kept";
    const Matrix6d more = a.covariance - b.covariance;
    const double least = Eigen::SelfAdjointEigenSolver<Matrix6d>(more).eigenvalues()[0];
    EXPECT_GT(least, -0.2 * b.covariance.trace()) << i;
    EXPECT_GT(more.trace(), 0) << i;
    ratio += std::sqrt(a.covariance.trace() / b.covariance.trace()) / orbit().size();
  }
  EXPECT_GT(ratio, 1.05);
  EXPECT_LT(ratio, 10);
}

// A map as the camera would have it, of points about it that it turns round; corners with a noise (pixels).
Map noisy_map(const TrackingRig& rig, float sigma = 0.3f) {
  constexpr int kKeyFrames = 40, kPoints = 400;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(-1, 1);
  std::normal_distribution<float> noise(0, sigma);
  Map map;
  map.tracks.resize(kPoints);
  for (Track& t : map.tracks) {
    t.position = {3 * place(random), 2 * place(random), 2 * place(random)};
    t.triangulated = true;
  }
  for (int k = 0; k < kKeyFrames; ++k) {
    MapKeyFrame& keyframe = map.keyframes.emplace_back();
    keyframe.frame = k;
    keyframe.rig_from_world = turning_pose(k);
    for (int t = 0; t < kPoints; ++t) {
      Eigen::Vector2d pixel;
      if (!rig.see(0, keyframe.rig_from_world * map.tracks[t].position, &pixel)) continue;
      const Eigen::Vector2f found = pixel.cast<float>() + Eigen::Vector2f(noise(random), noise(random));
      map.observe(t, k, keyframe.add(0, found, 0, t));
    }
  }
  return map;
}

// A key frame that no adjustment looks at any more still calls those inliers that were; points move.
TEST(CalibrationRefiner, WhatDoesNotFitAnyMoreSaysNothing) {
  const Rig given{{small_camera()}};
  const TrackingRig rig(given, ErrorMeasure::kPixel);
  const auto motion_of = [](int) { return RigMotion{}; };
  const auto numbers_of = [&](const Map& map) {
    CalibrationRefiner refiner(given, LensRefinement::kAuto);
    refiner.measure(rig, 0, map, {}, motion_of);
    EXPECT_FALSE(refiner.better(false));
    return refiner.numbers();
  };
  Map map = noisy_map(rig);
  const std::vector<CalibrationNumber> before = numbers_of(map);
  // Next to the plane of the last camera, far to the side.
  const MapKeyFrame& last = map.keyframes.back();
  for (int i = 0; i < 3; ++i) {
    map.tracks[last.tracks[i]].position = last.rig_from_world.inverse() * Eigen::Vector3d(1, 0.3 * i, 0.05);
  }
  const std::vector<CalibrationNumber> after = numbers_of(map);
  ASSERT_EQ(before.size(), after.size());
  for (size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(before[i].told, after[i].told) << before[i].name;
    EXPECT_NEAR(before[i].sigma, after[i].sigma, 0.1 * before[i].sigma) << before[i].name;
  }
}

// Matches that are wrong by less than an inlier may be were chosen by the lens that they fit.
TEST(CalibrationRefiner, MatchesThatFitTheGivenLensDoNotHoldIt) {
  constexpr double kLonger = 1.01;
  constexpr int kEvery = 4;
  const Rig given{{with_focal(kLonger)}};
  const TrackingRig rig(given, ErrorMeasure::kPixel);
  const auto lens = std::get<Radtan>(small_camera().model);
  const Eigen::Vector2f centre(static_cast<float>(lens.cx), static_cast<float>(lens.cy));
  Map map = noisy_map(TrackingRig({{small_camera()}}, ErrorMeasure::kPixel), 0.05f);
  int seen = 0;
  for (MapKeyFrame& k : map.keyframes) {
    for (Eigen::Vector2f& pixel : k.pixels) {
      if (++seen % kEvery == 0) pixel = centre + static_cast<float>(kLonger) * (pixel - centre);
    }
  }
  const auto motion_of = [](int) { return RigMotion{}; };
  const auto off = [&](CalibrationRefiner& refiner) {
    const std::optional<Rig> better = refiner.better(true);
    return better ? std::abs(std::get<Radtan>(better->cameras[0].model).fx / lens.fx - 1) : kLonger - 1;
  };
  CalibrationRefiner as_it_is(given, LensRefinement::kAuto), at_rest(given, LensRefinement::kAuto);
  as_it_is.measure(rig, 0, map, {}, motion_of);
  at_rest.measure_again(rig, 0, map, {}, motion_of, CalibrationRefiner::Measure::kAtRest);
  EXPECT_GT(off(as_it_is), 0.0015);
  EXPECT_LT(off(at_rest), 0.0005);
}

// As of a world that goes on from a saved map.
TEST(CalibrationRefiner, OnlyWhatIsLeftOutIsNotMeasured) {
  const Rig given{{small_camera()}};
  const TrackingRig rig(given, ErrorMeasure::kPixel);
  const Map map = noisy_map(rig);
  std::vector<uint8_t> left_out(map.keyframes.size(), 0);
  std::fill_n(left_out.begin(), 3, 1);
  left_out[20] = 1;
  for (const bool leaves_out : {false, true}) {
    CalibrationRefiner refiner(given, LensRefinement::kAuto);
    refiner.measure(rig, 0, map, leaves_out ? left_out : std::vector<uint8_t>(),
                    [](int) { return RigMotion{}; });
    EXPECT_FALSE(refiner.is_due(0, map, true)) << "nothing is left to be measured";
  }
}

// Of what was found in a first run through the same footage, anything better is as good.
TEST(CalibrationRefiner, WhatWasFoundHasNoStanding) {
  const Rig off{{with_focal(1.001)}};
  const TrackingRig rig(off, ErrorMeasure::kPixel);
  const Map map = noisy_map(TrackingRig({{small_camera()}}, ErrorMeasure::kPixel));
  const auto better = [&](bool is_found) {
    CalibrationRefiner refiner(off, LensRefinement::kAuto, {.is_found = is_found});
    refiner.measure(rig, 0, map, {}, [](int) { return RigMotion{}; });
    return refiner.better(true).has_value();
  };
  EXPECT_FALSE(better(false));
  EXPECT_TRUE(better(true));
}

TEST(CalibrationRefiner, ALensMovesOneStretchMoreThanAll) {
  const TrackingRig off({{with_focal(1.02)}}, ErrorMeasure::kPixel);
  const Map map = noisy_map(TrackingRig({{small_camera()}}, ErrorMeasure::kPixel));
  Map part;  // a short turn, which tells less
  part.tracks.resize(map.tracks.size());
  for (size_t t = 0; t < map.tracks.size(); ++t) {
    part.tracks[t].position = map.tracks[t].position;
    part.tracks[t].triangulated = true;
  }
  for (int k = 0; k < 8; ++k) {
    const MapKeyFrame& from = map.keyframes[k];
    MapKeyFrame& to = part.keyframes.emplace_back();
    to.frame = k;
    to.rig_from_world = from.rig_from_world;
    for (int f = 0; f < from.size(); ++f)
      part.observe(from.tracks[f], k, to.add(0, from.pixels[f], 0, from.tracks[f]));
  }
  const auto motion_of = [](int) { return RigMotion{}; };
  CalibrationRefiner refiner(off.rig(), LensRefinement::kAuto);
  refiner.measure(off, 0, map, {}, motion_of);
  ASSERT_TRUE(refiner.better(false));
  EXPECT_NEAR(refiner.greatest_effect(), refiner.effect(), 1e-9) << "of one stretch";
  refiner.measure(off, 1, part, {}, motion_of);
  ASSERT_TRUE(refiner.better(false));
  EXPECT_GT(refiner.greatest_effect(), 1.02 * refiner.effect());
  EXPECT_LT(refiner.greatest_effect(), 2 * refiner.effect());
}

// Their squares add up to the variance that is told of each number.
TEST(CalibrationRefiner, DeviationsAreAsWideAsTheNumbersAreUnsure) {
  Camera off = small_camera();
  std::get<Radtan>(off.model).fx *= 1.004;
  const TrackingRig exact({{small_camera()}}, ErrorMeasure::kPixel), rig({{off}}, ErrorMeasure::kPixel);
  CalibrationRefiner refiner({{off}}, LensRefinement::kAuto);
  EXPECT_TRUE(refiner.deviations().empty()) << "nothing is told yet";
  refiner.measure(rig, 0, noisy_map(exact), {}, [](int) { return RigMotion{}; });
  refiner.better(false);
  const auto numbers_of = [](const Rig& r) {
    const auto& lens = std::get<Radtan>(r.cameras[0].model);
    return std::map<std::string, double>{{"fx", lens.fx}, {"cx", lens.cx}, {"cy", lens.cy}, {"k1", lens.k1}};
  };
  std::map<std::string, double> squares;
  for (const Rig& other : refiner.deviations()) {
    for (const auto& [name, value] : numbers_of(other))
      squares[name] += std::pow(value - numbers_of(refiner.rig())[name], 2);
  }
  int told = 0;
  for (const CalibrationNumber& n : refiner.numbers()) {
    if (!n.told || !squares.contains(n.name)) continue;
    ++told;
    EXPECT_NEAR(std::sqrt(squares[n.name]), n.sigma, 0.01 * n.sigma) << n.name;
  }
  EXPECT_GE(told, 3);
}

RigMotion turning_motion(int keyframe) {
  const TimedPose after{keyframe + 1e-3, turning_pose(keyframe + 1e-3)};
  return motion_at({double(keyframe), turning_pose(keyframe)}, std::span(&after, 1));
}

// What cameras that are read downwards in `down` of its key frames, and else upwards, see of it.
Map scanned_map(int down) {
  constexpr double kReadout = 0.2;  // seconds
  Rig rolling{{small_camera()}};
  rolling.cameras[0].shutter.readout = kReadout;
  const TrackingRig downwards(rolling, ErrorMeasure::kPixel);
  rolling.cameras[0].shutter.direction = RollingShutter::Direction::kUp;
  const TrackingRig upwards(rolling, ErrorMeasure::kPixel);
  Map map = noisy_map(downwards);
  for (int k = 0; k < static_cast<int>(map.keyframes.size()); ++k) {
    MapKeyFrame& keyframe = map.keyframes[k];
    for (int f = 0; f < keyframe.size(); ++f) {
      keyframe.pixels[f] +=
          predict_scan_offset(k < down ? downwards : upwards, 0,
                              keyframe.rig_from_world * map.tracks[keyframe.tracks[f]].position,
                              turning_motion(k), keyframe.pixels[f].cast<double>());
    }
  }
  return map;
}

// Rows of a video that plays backwards are exposed in the other order.
TEST(CalibrationRefiner, AReadoutThatTurnsRoundIsDropped) {
  const Rig given{{small_camera()}};
  const TrackingRig rig(given, ErrorMeasure::kPixel);
  const int all = static_cast<int>(scanned_map(0).keyframes.size());
  for (const int down : {all, all / 2}) {
    const Map map = scanned_map(down);
    CalibrationRefiner refiner(given, LensRefinement::kAuto, {.readout = 0.4});
    EXPECT_EQ(refiner.drop_turning_shutter(rig, 0, map, turning_motion), down != all);
    refiner.measure(rig, 0, map, {}, turning_motion);
    const std::optional<Rig> better = refiner.better(false);
    const double readout = better ? better->cameras[0].shutter.readout : 0;
    EXPECT_NEAR(readout, down == all ? 0.2 : 0, 0.02) << down << " of " << all;
  }
}

// One that is off by less than it takes to be changed is kept, and is as far off as what is likelier. Of one
// film all are off to the same side: hence two.
TEST(CalibrationRefiner, TheSigmaOfAKeptNumberHasInItWhatIsLikelier) {
  const double truth = std::get<Radtan>(small_camera().model).fx;
  const SynthViews other = synth_views("room", "orbit", 120, 3);
  int told = 0, kept = 0;
  double squares = 0;
  for (const SynthViews* views : {&orbit(), &other}) {
    for (const double factor : {0.985, 0.99, 1.01, 1.015}) {
      Tracked run;
      track(*views, with_focal(factor), LensRefinement::kAuto, &run);
      const CalibrationNumber& fx = run.number("fx");
      if (!fx.told) continue;
      const double off = (fx.refined - truth) / fx.sigma;
      ++told;
      kept += fx.refined == fx.given;
      squares += off * off;
      EXPECT_LT(std::abs(off), 3) << factor;
      EXPECT_LT(fx.sigma, 0.02 * fx.given) << factor;
    }
  }
  EXPECT_GE(told, 6);
  EXPECT_GE(kept, 2);
  EXPECT_LT(std::sqrt(squares / told), 2);
}

// Along a straight line a world that is longer looks the same through a longer lens.
TEST(CalibrationRefiner, AStraightDriveDoesNotTellTheFocalLength) {
  const SynthViews views = synth_views("corridor", "straight", 60);
  Tracked run;
  track(views, with_focal(1.02), LensRefinement::kAuto, &run);
  const CalibrationNumber& fx = run.number("fx");
  EXPECT_FALSE(fx.told);
  EXPECT_EQ(fx.refined, fx.given);
}

// A picture as a lens of `factor` times the focal length shows it.
GrayImage zoomed(const GrayImage& image, float factor) {
  GrayImage out(image.width(), image.height());
  const float cx = 0.5f * static_cast<float>(image.width() - 1),
              cy = 0.5f * static_cast<float>(image.height() - 1);
  for (int y = 0; y < out.height(); ++y) {
    for (int x = 0; x < out.width(); ++x) {
      const float u = cx + (static_cast<float>(x) - cx) / factor,
                  v = cy + (static_cast<float>(y) - cy) / factor;
      const int i = static_cast<int>(u), j = static_cast<int>(v);
      const float s = u - static_cast<float>(i), t = v - static_cast<float>(j);
      const auto at = [&](int column, int row) {
        return static_cast<float>(
            image.row(std::min(row, image.height() - 1))[std::min(column, image.width() - 1)]);
      };
      out.row(y)[x] = static_cast<uint8_t>(std::lround((1 - t) * ((1 - s) * at(i, j) + s * at(i + 1, j)) +
                                                       t * ((1 - s) * at(i, j + 1) + s * at(i + 1, j + 1))));
    }
  }
  return out;
}

// Round and back, with one focal length or with another on the way back.
TEST(CalibrationRefiner, AZoomIsSeen) {
  const auto change = [&](float factor) {
    Odometry odometry({{small_camera()}}, {});
    const int there = orbit().size();
    for (int i = 0; i < 2 * there; ++i) {
      const float zoom = i < there ? 1 : factor;
      odometry.process(as_view(zoomed(orbit().images[i < there ? i : 2 * there - 1 - i], zoom), i));
    }
    return odometry.lens_change();
  };
  EXPECT_FALSE(change(1));
  EXPECT_TRUE(change(1.06f));
  const std::optional<SeenZoom> seen = change(1.15f);
  ASSERT_TRUE(seen);
  EXPECT_NEAR(seen->after / seen->before, 1.15, 0.06);
  EXPECT_NEAR(seen->frame, orbit().size(), 40);
}

TEST(CalibrationRefiner, ALensOfAnotherKindOfPictureIsNamedAsSuch) {
  Tracked run;
  track(orbit(), with_focal(1.25), LensRefinement::kAuto, &run);
  ASSERT_FALSE(run.heard.refined.empty());
  EXPECT_TRUE(run.heard.refined.back().contradicts);
  const double truth = std::get<Radtan>(small_camera().model).fx;
  EXPECT_NEAR(run.number("fx").refined, truth, 0.04 * truth);
}

TEST(CalibrationRefiner, TwoRunsAreTheSameToTheLastBit) {
  Tracked a, b;
  track(orbit(), with_focal(1.03), LensRefinement::kAuto, &a);
  track(orbit(), with_focal(1.03), LensRefinement::kAuto, &b);
  EXPECT_EQ(a.number("fx").refined, b.number("fx").refined);
  EXPECT_EQ(a.percent, b.percent);
}

}  // namespace
}  // namespace raysfm
