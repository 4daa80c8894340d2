#include "raysfm/projective/degeneracy.h"

#include <gtest/gtest.h>

#include "raysfm/lenses/lens_adjustment.h"
#include "support/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::add_noise;
using test_scenes::Cube;
using test_scenes::make_cube;
using test_scenes::perturbed;
using test_scenes::project_all;

constexpr double kNoise = 0.4;  // pixels, as of tracks on video
constexpr double kPrior = 15;   // pixels, of the principal point

// What is said after the adjustment of noisy observations of `cube` from near the truth; `prior_px`: standard
// deviation of the principal point about the centre, 0 where nothing is known of it.
std::string named(Cube cube, bool equal, double prior_px, Rng* rng) {
  project_all(cube.truth, &cube.tracks);
  add_noise(kNoise, rng, &cube.tracks);
  UncalibratedScene scene = perturbed(cube.truth, 1e-3, rng);
  LensAdjustmentOptions options;
  options.constraints.equal = equal;
  options.constraints.principal_point = cube.tracks.centre();
  options.constraints.principal_point_sigma = prior_px / kNoise;
  const auto summary = adjust_polished(cube.tracks, {}, options, &scene);
  if (!summary) return summary.error().message;
  const std::vector<uint8_t> posed(cube.tracks.image_count, 1), placed(cube.tracks.point_count, 1);
  return name_degeneracy(scene, posed, placed, summary->lens_sigma);
}

Cube cube_of(bool zooming, Rng* rng) {
  return make_cube({.images = 8, .points = 60, .zooming = zooming}, rng);
}

TEST(Degeneracy, NoFalseAlarmOnGeneralMotion) {
  int alarms = 0;
  for (uint64_t trial = 0; trial < 200; ++trial) {
    Rng rng(trial, 1);
    const bool zooming = trial % 2 == 1;
    const std::string name = named(cube_of(zooming, &rng), !zooming, kPrior, &rng);
    alarms += !name.empty();
    EXPECT_EQ(name, "") << "trial " << trial;
  }
  EXPECT_EQ(alarms, 0);
}

// The camera turns about its centre.
TEST(Degeneracy, PureRotation) {
  for (const bool zooming : {false, true}) {
    Rng rng(21);
    Cube cube = cube_of(zooming, &rng);
    for (Rigid3& pose : cube.truth.cam_from_world) {
      pose = {exp_so3({rng.uniform(-0.15, 0.15), rng.uniform(-0.15, 0.15), rng.uniform(-1, 1)}),
              Eigen::Vector3d::Zero()};
      pose.translation = pose.rotation * Eigen::Vector3d(0, 0, 6);
    }
    EXPECT_EQ(named(cube, !zooming, kPrior, &rng), "pure rotation") << zooming;
  }
}

TEST(Degeneracy, PureTranslation) {
  for (const bool zooming : {false, true}) {
    Rng rng(22);
    Cube cube = cube_of(zooming, &rng);
    for (Rigid3& pose : cube.truth.cam_from_world) {
      pose = {Eigen::Quaterniond::Identity(),
              Eigen::Vector3d(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(5, 9))};
    }
    EXPECT_EQ(named(cube, !zooming, kPrior, &rng), "pure translation") << zooming;
  }
}

// The camera rolls as it moves: its optical axes stay parallel.
TEST(Degeneracy, ParallelOpticalAxes) {
  for (const bool zooming : {false, true}) {
    Rng rng(23);
    Cube cube = cube_of(zooming, &rng);
    for (Rigid3& pose : cube.truth.cam_from_world) {
      pose = {exp_so3({0, 0, rng.uniform(-1, 1)}),
              Eigen::Vector3d(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(5, 9))};
    }
    EXPECT_EQ(named(cube, !zooming, kPrior, &rng), "parallel optical axes") << zooming;
  }
}

// Around the object at one height and distance, looking at its middle; nothing known of the principal points.
TEST(Degeneracy, OpticalAxesThroughOnePoint) {
  Rng rng(24);
  Cube cube = cube_of(true, &rng);
  for (size_t j = 0; j < cube.truth.cam_from_world.size(); ++j) {
    const double a = 0.03 * double(j);
    cube.truth.cam_from_world[j] = test_scenes::looking_at_origin({7 * std::sin(a), 0, 7 * std::cos(a)}, 0);
    cube.truth.lenses[j] = {1000, 1000, 250, 250, 0};
  }
  EXPECT_EQ(named(cube, false, 0, &rng), "optical axes through one point");
}

// A plane seen with a lens that zooms.
TEST(Degeneracy, PlanarScene) {
  Rng rng(25);
  Cube cube = make_cube({.images = 8, .points = 60, .zooming = true, .arc = 0.6}, &rng);
  for (Eigen::Vector3d& x : cube.truth.points) x.z() = 0;
  EXPECT_EQ(named(cube, false, 0, &rng), "planar scene");
}

}  // namespace
}  // namespace raysfm
