// Rolling shutters: rendered row by row, against the same footage with a global shutter.
#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/eval/trajectory_error.h"
#include "raysfm/odometry/odometry.h"
#include "raysfm/scene/worlds.h"
#include "support/synth_views.h"

namespace raysfm {
namespace {

using testing_support::small_camera;
using testing_support::synth_views;
using testing_support::SynthViews;

constexpr int kFrames = 120;
constexpr double kReadout = 0.033;  // seconds of the world

const SynthViews& global_shutter() {
  static const SynthViews views = synth_views("room", "handheld", kFrames);
  return views;
}
const SynthViews& rolling_shutter() {
  static const SynthViews views = synth_views("room", "handheld", kFrames, 0, kReadout);
  return views;
}

// The readout in the time that the views are stamped with.
double stamped_readout(const SynthViews& views) {
  const double passed = views.view(1, 1)->timestamp - views.view(0, 0)->timestamp;
  return kReadout * passed / (views.timestamps[1] - views.timestamps[0]);
}

Reconstruction track_scanned(const SynthViews& views, double readout, const OdometryOptions& options = {},
                             RollingShutter* found = nullptr) {
  Camera camera = small_camera();
  camera.shutter.readout = readout;
  Odometry odometry({{camera}}, options);
  for (int i = 0; i < views.size(); ++i) odometry.process(views.view(i, i));
  Reconstruction result = odometry.finish(false);
  if (found) *found = odometry.rig().camera(0).shutter;
  return result;
}

// Mean error of the positions in percent of the path; all frames must be posed.
double percent_of_path(const Reconstruction& r, const SynthViews& views) {
  Trajectory estimate, truth;
  for (int i = 0; i < views.size(); ++i) {
    truth.timestamps.push_back(i);
    truth.world_from_cam.push_back(views.world_from_rig[i]);
    if (!r.frames[i].world_from_rig) {
      ADD_FAILURE() << i << ": " << r.frames[i].reason;
      continue;
    }
    estimate.timestamps.push_back(i);
    estimate.world_from_cam.push_back(*r.frames[i].world_from_rig);
  }
  const auto error = evaluate(estimate, truth, {.alignment = Alignment::kSim3});
  EXPECT_TRUE(error) << error.error().message;
  return error ? error->percent_of_path() : NAN;
}

TEST(OdometryScan, ARollingShutterThatIsToldIsAsGoodAsAGlobalOne) {
  const double global = percent_of_path(track_scanned(global_shutter(), 0), global_shutter());
  const double bent = percent_of_path(track_scanned(rolling_shutter(), 0), rolling_shutter());
  const double straight = percent_of_path(
      track_scanned(rolling_shutter(), stamped_readout(rolling_shutter())), rolling_shutter());
  EXPECT_GT(bent, 4 * global);
  EXPECT_LT(straight, 1.5 * global);
}

TEST(OdometryScan, AReadoutThatNobodyToldIsFound) {
  const SynthViews& views = rolling_shutter();
  OdometryOptions options;
  options.calibration_prior.readout = 2 * stamped_readout(views);
  RollingShutter found;
  const Reconstruction r = track_scanned(views, 0, options, &found);
  EXPECT_EQ(found.direction, RollingShutter::Direction::kDown);
  EXPECT_NEAR(found.readout / stamped_readout(views), 1, 0.05);
  const double global = percent_of_path(track_scanned(global_shutter(), 0), global_shutter());
  EXPECT_LT(percent_of_path(r, views), 1.5 * global);
}

TEST(OdometryScan, AReadoutThatWasFoundBeforeIsFoundBetter) {
  const SynthViews& views = rolling_shutter();
  OdometryOptions options;
  options.calibration_prior.readout = 2 * stamped_readout(views);
  RollingShutter found;
  track_scanned(views, 0.8 * stamped_readout(views), options, &found);
  EXPECT_NEAR(found.readout / stamped_readout(views), 1, 0.05);
}

// What tracking from a guess is for.
TEST(OdometryScan, TheCalibrationIsTheSameWhereMapsAreNotFinished) {
  OdometryOptions options;
  options.calibration_prior.readout = 2 * stamped_readout(rolling_shutter());
  const Reconstruction finished = track_scanned(rolling_shutter(), 0, options);
  options.finishes_maps = false;
  const Reconstruction rough = track_scanned(rolling_shutter(), 0, options);
  ASSERT_EQ(rough.calibration.size(), finished.calibration.size());
  for (size_t i = 0; i < rough.calibration.size(); ++i)
    EXPECT_EQ(rough.calibration[i].refined, finished.calibration[i].refined) << rough.calibration[i].name;
  EXPECT_EQ(posed_count(rough), posed_count(finished));
  ASSERT_FALSE(rough.points.empty() || finished.points.empty());
  EXPECT_NE(rough.points[0].position, finished.points[0].position);
}

// Time stamps that count frames are seconds of another length.
TEST(OdometryScan, AReadoutIsFoundInAnyUnitOfTime) {
  constexpr double kUnits = 30;  // to a second
  const SynthViews& views = rolling_shutter();
  OdometryOptions options;
  options.calibration_prior.readout = kUnits * 2 * stamped_readout(views);
  options.velocity_reach *= kUnits;
  Odometry odometry({{small_camera()}}, options);
  for (int i = 0; i < views.size(); ++i) odometry.process(views.view(i, i, 0.1 * kUnits));
  odometry.finish(false);
  const RollingShutter found = odometry.rig().camera(0).shutter;
  EXPECT_NEAR(found.readout / (kUnits * stamped_readout(views)), 1, 0.1);
}

TEST(OdometryScan, NoReadoutIsFoundWhereThereIsNone) {
  OdometryOptions options;
  options.calibration_prior.readout = 2 * stamped_readout(global_shutter());
  RollingShutter found;
  track_scanned(global_shutter(), 0, options, &found);
  EXPECT_EQ(found.readout, 0);
}

}  // namespace
}  // namespace raysfm
