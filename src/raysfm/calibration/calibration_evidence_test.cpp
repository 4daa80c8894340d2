#include "raysfm/calibration/calibration_evidence.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/calibration/calibration_choice.h"
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
