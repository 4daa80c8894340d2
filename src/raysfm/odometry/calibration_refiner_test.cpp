// Calibrations that are wrong on purpose, on rendered images whose lens is exact.
#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/eval/trajectory_error.h"
#include "raysfm/odometry/odometry.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

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

TEST(CalibrationRefiner, AnExactCalibrationStays) {
  Tracked run;
  track(orbit(), small_camera(), LensRefinement::kAuto, &run);
  EXPECT_TRUE(run.heard.refined.empty());
  ASSERT_FALSE(run.result.calibration.empty());
  for (const CalibrationNumber& n : run.result.calibration) EXPECT_EQ(n.given, n.refined) << n.name;
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
