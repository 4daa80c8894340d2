#include "raysfm/calibration/calibration_evidence.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/calibration/calibration_choice.h"
#include "raysfm/core/random.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

using test::BundleScene;
using test::make_bundle_scene;

const BundleOptions kToTheEnd{.max_iterations = 200, .min_relative_decrease = 1e-14, .initial_damping = 1e-8};

Camera distorted(double k1) {
  Camera camera = test::pinhole_camera();
  camera.model = Radtan{500, 510, 320, 240, k1};
  return camera;
}

BundleScene turning_scene(const std::vector<Camera>& cameras, uint64_t seed = 1) {
  return make_bundle_scene({.poses = 12,
                            .free_poses = 11,
                            .points = 300,
                            .track = 6,
                            .noise_px = 0.3,
                            .pose_error = 0.001,
                            .point_error = 0.005,
                            .seed = seed,
                            .cameras = cameras});
}

// The least cost of a scene whose cameras are such.
double least_cost(BundleScene scene, const RigParameters& parameters, const Eigen::VectorXd& values,
                  bool angular) {
  scene.cameras = parameters.rig(values).cameras;
  if (angular) test::observe_rays(&scene, AngularWeight::kPixel);
  BundleAdjuster adjuster;
  return adjuster.adjust(scene.problem(), kToTheEnd).final_cost;
}

struct Views {
  const char* name;
  std::vector<Camera> cameras;
  bool angular;
};

std::vector<Views> kinds_of_views() {
  std::vector<Camera> stereo(2, distorted(0.01));
  stereo[1].rig_from_cam = {exp_so3({0.01, -0.02, 0.005}), {0.5, 0.02, 0}};
  return {{"pinhole", {test::pinhole_camera()}, false},
          {"stereo", stereo, false},
          {"angular", {distorted(-0.05)}, true}};
}

constexpr double kCurvature = 0.05;  // that residuals have, and their squares' second derivative leaves out

// Poses and points adapted, the cost is a function of the calibration alone: its derivatives by differences
// of complete adjustments.
TEST(CalibrationEvidence, IsTheDerivativeOfTheLeastCost) {
  for (const Views& views : kinds_of_views()) {
    BundleScene scene = turning_scene(views.cameras);
    const RigParameters parameters({views.cameras});
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(parameters.size());
    scene.cameras = parameters.rig(zero).cameras;
    if (views.angular) test::observe_rays(&scene, AngularWeight::kPixel);
    BundleAdjuster adjuster;
    const double cost = adjuster.adjust(scene.problem(), kToTheEnd).final_cost;
    const auto evidence = measure_calibration(scene.problem(), kToTheEnd, parameters, zero);
    ASSERT_TRUE(evidence) << views.name;
    EXPECT_NEAR(evidence->cost, cost, 1e-6 * cost) << views.name;
    EXPECT_EQ(evidence->observations, static_cast<int>(scene.observations.size())) << views.name;
    for (int i = 0; i < parameters.size(); ++i) {
      const double h = 0.3 / std::sqrt(evidence->information(i, i) + 1);
      const Eigen::VectorXd step = h * Eigen::VectorXd::Unit(parameters.size(), i);
      const double after = least_cost(scene, parameters, step, views.angular),
                   before = least_cost(scene, parameters, -step, views.angular);
      const double scale = std::sqrt(evidence->information(i, i) + 1);
      EXPECT_NEAR((after - before) / (2 * h) / scale, evidence->gradient[i] / scale, 0.05)
          << views.name << " " << parameters.name(i);
      EXPECT_NEAR((after - 2 * cost + before) / (h * h * scale * scale),
                  evidence->information(i, i) / (scale * scale), kCurvature)
          << views.name << " " << parameters.name(i);
    }
  }
}

// A readout moves what was observed by how fast it moves in the image, and by how late it is exposed.
TEST(CalibrationEvidence, KnowsWhatAReadoutDoes) {
  for (const bool angular : {false, true}) {
    const Camera camera = distorted(-0.05);
    BundleScene scene = turning_scene({camera});
    const RigParameters parameters({{camera}}, 1, {.readout = 0.02});
    const int count = parameters.size();
    ASSERT_EQ(parameters.name(count - 2), "readout_down");
    ASSERT_EQ(parameters.name(count - 1), "readout_right");
    std::vector<Eigen::Vector2d> velocities;
    Rng random(3);
    for (size_t i = 0; i < scene.observations.size(); ++i) {
      const int pose = scene.observations[i].pose;
      velocities.emplace_back(300 * std::sin(pose) + 20 * random.uniform(), 200 * std::cos(2 * pose));
    }
    const auto cost_with = [&](int axis, double readout) {
      BundleScene moved = scene;
      for (size_t i = 0; i < velocities.size(); ++i) {
        Eigen::Vector2d& pixel = moved.observations[i].pixel;
        const double part = axis == 0 ? (pixel.y() + 0.5) / camera.height : (pixel.x() + 0.5) / camera.width;
        pixel -= readout * (part - 0.5) * velocities[i];
      }
      if (angular) test::observe_rays(&moved, AngularWeight::kPixel);
      BundleAdjuster adjuster;
      return adjuster.adjust(moved.problem(), kToTheEnd).final_cost;
    };
    if (angular) test::observe_rays(&scene, AngularWeight::kPixel);
    BundleAdjuster adjuster;
    const double cost = adjuster.adjust(scene.problem(), kToTheEnd).final_cost;
    const auto evidence =
        measure_calibration(scene.problem(), kToTheEnd, parameters, Eigen::VectorXd::Zero(count),
                            AngularWeight::kPixel, velocities);
    ASSERT_TRUE(evidence);
    for (const int axis : {0, 1}) {
      const int i = count - 2 + axis;
      const double scale = std::sqrt(evidence->information(i, i)), h = 0.3 / scale;
      const double after = cost_with(axis, h), before = cost_with(axis, -h);
      EXPECT_NEAR((after - before) / (2 * h) / scale, evidence->gradient[i] / scale, 0.05) << axis;
      EXPECT_NEAR((after - 2 * cost + before) / (h * h * scale * scale), 1, kCurvature) << axis;
    }
  }
}

// Rows and columns are not scanned at once: of two readouts the surer one is taken.
TEST(CalibrationChoice, TakesOneReadout) {
  const RigParameters parameters({{distorted(0)}}, 1, {.readout = 0.02});
  const int count = parameters.size();
  CalibrationEvidence evidence = CalibrationEvidence::nothing(Eigen::VectorXd::Zero(count));
  evidence.information.diagonal().setConstant(1e-6);
  for (const int i : {count - 2, count - 1}) evidence.information(i, i) = 1e9;
  evidence.gradient[count - 2] = 1e9 * -0.01;
  evidence.gradient[count - 1] = 1e9 * 0.025;
  evidence.observations = 1000;
  evidence.cost = 500;
  const CalibrationChoice choice = choose_calibration(parameters, evidence);
  EXPECT_EQ(choice.values[count - 2], 0);
  EXPECT_NEAR(choice.values[count - 1], -0.025, 1e-4);
  EXPECT_EQ(choice.sigma[count - 2], 0.02);
  const Rig rig = parameters.rig(choice.values);
  EXPECT_EQ(rig.cameras[0].shutter.direction, RollingShutter::Direction::kLeft);
  EXPECT_NEAR(rig.cameras[0].shutter.readout, 0.025, 1e-4);
  EXPECT_NEAR(parameters.number(count - 1, 0, rig), -0.025, 1e-4);
  EXPECT_EQ(parameters.number(count - 2, 0, rig), 0);
}

// The length of a baseline makes the world larger and changes no image.
TEST(CalibrationEvidence, NothingTellsTheLengthOfABaseline) {
  std::vector<Camera> stereo(2, test::pinhole_camera());
  stereo[1].rig_from_cam.translation = {0.5, 0, 0};
  BundleScene scene = turning_scene(stereo);
  const RigParameters parameters({stereo});
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(parameters.size());
  scene.cameras = parameters.rig(zero).cameras;
  BundleAdjuster adjuster;
  adjuster.adjust(scene.problem(), kToTheEnd);
  const auto evidence = measure_calibration(scene.problem(), kToTheEnd, parameters, zero);
  ASSERT_TRUE(evidence);
  const CalibrationChoice choice = choose_calibration(parameters, *evidence);
  for (int i = 0; i < parameters.size(); ++i) {
    if (parameters.name(i) == "translation[0]") {
      EXPECT_FALSE(choice.is_told[i]);
    }
    if (parameters.name(i) == "rotation[1]") {
      EXPECT_TRUE(choice.is_told[i]);
    }
  }
}

TEST(CalibrationEvidence, NothingMovesNothingIsMeasured) {
  BundleScene scene = turning_scene({test::pinhole_camera()});
  const RigParameters parameters({{test::pinhole_camera()}});
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(parameters.size());
  scene.observations.clear();
  scene.is_inlier.clear();
  EXPECT_FALSE(measure_calibration(scene.problem(), kToTheEnd, parameters, zero));
}

// A pose that sees one point adds nothing, and takes nothing from what the others tell.
TEST(CalibrationEvidence, APoseThatIsNotToldLeavesTheOthers) {
  constexpr int kPose = 5;
  BundleScene scene = turning_scene({test::pinhole_camera()});
  const RigParameters parameters({{test::pinhole_camera()}});
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(parameters.size());
  scene.cameras = parameters.rig(zero).cameras;
  BundleAdjuster adjuster;
  adjuster.adjust(scene.problem(), kToTheEnd);
  int last = -1;
  for (int i = 0; i < static_cast<int>(scene.observations.size()); ++i) {
    if (scene.observations[i].pose != kPose) continue;
    scene.is_inlier[i] = 0;
    last = i;
  }
  ASSERT_GE(last, 0);
  const auto without = measure_calibration(scene.problem(), kToTheEnd, parameters, zero);
  ASSERT_TRUE(without);
  scene.is_inlier[last] = 1;
  const auto with_one = measure_calibration(scene.problem(), kToTheEnd, parameters, zero);
  ASSERT_TRUE(with_one);
  EXPECT_EQ(with_one->observations, without->observations + 1);
  for (int i = 0; i < parameters.size(); ++i) {
    EXPECT_NEAR(with_one->information(i, i) / without->information(i, i), 1, 1e-4) << parameters.name(i);
    EXPECT_NEAR(with_one->gradient[i], without->gradient[i], 1e-3 * std::sqrt(without->information(i, i)));
  }
}

// Wrong by k1 on purpose. Two linearisations find what the images were made with, and errors are about as
// large as stated, which errs to the safe side: neighbours and images count as alike.
TEST(CalibrationEvidence, FindsTheLensAndKnowsHowWell) {
  constexpr int kTrials = 20;
  constexpr double kTruth = 0.08;
  double squares = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    BundleScene scene = turning_scene({distorted(kTruth)}, trial);
    const RigParameters parameters({{test::pinhole_camera()}});
    Eigen::VectorXd values = Eigen::VectorXd::Zero(parameters.size());
    CalibrationChoice choice;
    for (int round = 0; round < 2; ++round) {
      scene.cameras = parameters.rig(values).cameras;
      BundleAdjuster adjuster;
      adjuster.adjust(scene.problem(), kToTheEnd);
      const auto evidence = measure_calibration(scene.problem(), kToTheEnd, parameters, values);
      ASSERT_TRUE(evidence);
      choice = choose_calibration(parameters, *evidence);
      values = choice.values;
    }
    const int k1 = 4;
    ASSERT_EQ(parameters.name(k1), "k1");
    EXPECT_TRUE(choice.is_told[k1]);
    squares += std::pow((values[k1] - kTruth) / choice.sigma[k1], 2) / kTrials;
  }
  EXPECT_GT(squares, 0.08);
  EXPECT_LT(squares, 1.2);
}

// Where evidence is collected about two calibrations, the sum is that about one.
TEST(CalibrationEvidence, AddsUpAboutOneCalibration) {
  Rng rng(3);
  const int n = 4;
  const auto random = [&] {
    return Eigen::VectorXd::NullaryExpr(n, [&](auto) { return rng.normal(); }).eval();
  };
  CalibrationEvidence a = CalibrationEvidence::nothing(random()), b = CalibrationEvidence::nothing(random());
  const Eigen::VectorXd optimum = random();
  for (CalibrationEvidence* e : {&a, &b}) {
    const Eigen::MatrixXd root = Eigen::MatrixXd::NullaryExpr(n, n, [&](auto, auto) { return rng.normal(); });
    e->information = root * root.transpose() + Eigen::MatrixXd::Identity(n, n);
    e->gradient = e->information * (e->at - optimum);  // of a quadratic that is least at the optimum
  }
  a.add(b);
  const Eigen::VectorXd found = a.at - a.information.ldlt().solve(a.gradient);
  EXPECT_LT((found - optimum).norm(), 1e-9);
}

}  // namespace
}  // namespace raysfm
