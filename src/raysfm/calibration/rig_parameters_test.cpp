#include "raysfm/calibration/rig_parameters.h"

#include <gtest/gtest.h>

#include <map>

#include "support/model_fixtures.h"

namespace raysfm {
namespace {

template <typename Model>
Rig rig_of() {
  Camera camera;
  camera.model = testing_support::fixtures<Model>()[0];
  camera.width = 640, camera.height = 480;
  return {{camera}};
}

Rig stereo_rig() {
  Rig rig = rig_of<Pinhole>();
  rig.cameras.push_back(rig.cameras[0]);
  rig.cameras[1].rig_from_cam.translation = {0.5, 0, 0};
  return rig;
}

// Largest angle between the rays of two cameras over the image, in their own frames.
double largest_angle(const Camera& a, const Camera& b) {
  double most = 0;
  for (int x = 20; x < a.width; x += 40) {
    for (int y = 20; y < a.height; y += 40) {
      Ray ray_a, ray_b;
      if (!a.ray({x, y}, &ray_a) || !b.ray({x, y}, &ray_b)) continue;
      most = std::max(most, (ray_a.direction - ray_b.direction).norm());
    }
  }
  return most;
}

template <typename Model>
void expect_steps_are_small() {
  const Rig rig = rig_of<Model>();
  const RigParameters parameters(rig);
  ASSERT_GT(parameters.size(), 0);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(parameters.size());
  EXPECT_LT(largest_angle(parameters.rig(zero).cameras[0], rig.cameras[0]), 1e-9) << Model::kName;
  for (int i = 0; i < parameters.size(); ++i) {
    const double prior = parameters[i].prior_sigma;
    EXPECT_GT(prior, 0);
    const Rig moved = parameters.rig(prior * Eigen::VectorXd::Unit(parameters.size(), i));
    const double angle = largest_angle(moved.cameras[0], rig.cameras[0]);
    EXPECT_GT(angle, 1e-5) << Model::kName << " " << parameters.name(i);
    EXPECT_LT(angle, 0.2) << Model::kName << " " << parameters.name(i);
  }
}

// Each part of a prior is that of its own numbers, in their units, and no step depends on it.
TEST(RigParameters, PriorsAreThoseThatAreGiven) {
  const CalibrationPrior usual, wide{.focal = 0.1, .aspect = 0.01, .centre = 0.03, .rim = 0.12};
  const RigParameters a(rig_of<Radtan>(), 1, usual), b(rig_of<Radtan>(), 2, wide);
  ASSERT_EQ(a.size(), b.size());
  const std::map<std::string, double> factors = {{"fx", 5}, {"fy", 5}, {"cx", 3},
                                                 {"cy", 3}, {"k1", 4}, {"k2", 4}};
  ASSERT_EQ(a.size(), static_cast<int>(factors.size()));
  for (int i = 0; i < a.size(); ++i) {
    EXPECT_NEAR(b[i].prior_sigma, 2 * factors.at(a.name(i)) * a[i].prior_sigma, 1e-12) << a.name(i);
    EXPECT_EQ(b[i].step, a[i].step) << a.name(i);
  }
  EXPECT_DOUBLE_EQ(b[0].prior_sigma, 0.2);
  EXPECT_DOUBLE_EQ(b[2].prior_sigma, 2 * 0.03 * 640);
}

// As far off as the prior allows, no model becomes another camera, and every number does something.
TEST(RigParameters, EveryNumberMovesTheRaysALittle) {
  expect_steps_are_small<Pinhole>();
  expect_steps_are_small<Radtan>();
  expect_steps_are_small<Rational>();
  expect_steps_are_small<KannalaBrandt>();
  expect_steps_are_small<Unified>();
  expect_steps_are_small<DoubleSphere>();
  expect_steps_are_small<Eucm>();
  expect_steps_are_small<Mirror>();
}

TEST(RigParameters, ATableOfRaysOrAPanoramaHasNone) {
  EXPECT_EQ(RigParameters(rig_of<Equirectangular>()).size(), 0);
}

TEST(RigParameters, TheFocalLengthKeepsTheAspect) {
  const Rig rig = rig_of<Radtan>();
  const RigParameters parameters(rig);
  const auto given = std::get<Radtan>(rig.cameras[0].model);
  const auto moved = std::get<Radtan>(
      parameters.rig(std::log(1.1) * Eigen::VectorXd::Unit(parameters.size(), 0)).cameras[0].model);
  EXPECT_NEAR(moved.fx, 1.1 * given.fx, 1e-9);
  EXPECT_NEAR(moved.fy, 1.1 * given.fy, 1e-9);
  EXPECT_EQ(moved.k1, given.k1);
}

TEST(RigParameters, CamerasOfOneMakeShareTheUnknownsOfTheFirst) {
  const RigParameters parameters(stereo_rig());
  const int shared = RigParameters(rig_of<Pinhole>()).size();
  for (int i = 0; i < parameters.size(); ++i) {
    EXPECT_TRUE(parameters.concerns(i, 1));
    EXPECT_EQ(parameters.concerns(i, 0), i < shared);
  }
  const Rig moved = parameters.rig(0.01 * Eigen::VectorXd::Unit(parameters.size(), 0));
  EXPECT_EQ(std::get<Radtan>(moved.cameras[0].model).fx, std::get<Radtan>(moved.cameras[1].model).fx);
  Rig other = stereo_rig();
  other.cameras[1].width = 800;
  for (int i = 0; i < shared; ++i) EXPECT_FALSE(RigParameters(other).concerns(i, 1));
}

// Calibrations of one lens differ by a few percent, and other lenses by more.
TEST(RigParameters, CamerasOfOtherFocalLengthsShareNothing) {
  for (const double factor : {0.8, 0.97, 1.03, 1.25}) {
    Rig rig = stereo_rig();
    Pinhole& second = std::get<Pinhole>(rig.cameras[1].model);
    second.fx *= factor, second.fy *= factor;
    EXPECT_EQ(RigParameters(rig).concerns(0, 1), std::abs(factor - 1) < 0.05) << factor;
  }
}

TEST(RigParameters, AShutterThatWasFoundIsWhereTheyBegin) {
  using Direction = RollingShutter::Direction;
  for (const Direction direction : {Direction::kDown, Direction::kUp, Direction::kLeft, Direction::kRight}) {
    Rig rig = stereo_rig();
    for (Camera& camera : rig.cameras) camera.shutter = {0.012, direction};
    const RigParameters held(rig);
    EXPECT_EQ(held.first_values(), Eigen::VectorXd::Zero(held.size()));
    EXPECT_EQ(held.given().cameras[1].shutter.readout, 0.012);

    const RigParameters free(rig, 1, {.readout = 0.02});
    EXPECT_EQ(free.given().cameras[1].shutter.readout, 0);
    const Rig first = free.rig(free.first_values());
    for (const Camera& camera : first.cameras) {
      EXPECT_EQ(camera.shutter.readout, 0.012);
      EXPECT_EQ(camera.shutter.direction, direction);
    }
  }
}

TEST(RigParameters, NumbersAreThoseOfTheCamera) {
  const RigParameters parameters(stereo_rig());
  Eigen::VectorXd values(parameters.size());
  for (int i = 0; i < parameters.size(); ++i) values[i] = 0.1 * parameters[i].prior_sigma;
  const Rig moved = parameters.rig(values);
  for (int i = 0; i < parameters.size(); ++i) {
    const int camera = parameters[i].camera;
    const double given = parameters.number(i, camera, parameters.given());
    const double now = parameters.number(i, camera, moved);
    if (parameters.name(i).starts_with("rotation")) {
      EXPECT_NEAR(given, 0, 1e-12);
      EXPECT_NEAR(now, values[i], 1e-4 * parameters[i].prior_sigma + 1e-5);
    } else {
      EXPECT_NE(given, now) << parameters.name(i);
    }
  }
  EXPECT_EQ(parameters.number(0, 0, moved), std::get<Radtan>(moved.cameras[0].model).fx);
}

}  // namespace
}  // namespace raysfm
