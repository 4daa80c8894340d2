#include "raysfm/lenses/lens_adjustment.h"

#include <gtest/gtest.h>

#include <cmath>

#include "support/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::add_noise;
using test_scenes::Cube;
using test_scenes::make_cube;
using test_scenes::perturbed;
using test_scenes::structure_error;

using Adjust = Result<LensAdjustmentSummary> (*)(const PointTracks&, std::span<const double>,
                                                 const LensAdjustmentOptions&, UncalibratedScene*);

LensAdjustmentOptions options_for(bool zooming) {
  LensAdjustmentOptions options;
  options.constraints.equal = !zooming;
  return options;
}

double largest_lens_error(const UncalibratedScene& scene, const UncalibratedScene& truth) {
  double largest = 0;
  for (size_t j = 0; j < truth.lenses.size(); ++j) {
    const LensVector error = scene.lenses[j].vector() - truth.lenses[j].vector();
    largest = std::max(largest, error.cwiseAbs().maxCoeff() / truth.lenses[j].fx);
  }
  return largest;
}

struct Variant {
  const char* name;
  Adjust adjust;
  bool zooming;
  ConstraintMethod method = ConstraintMethod::kWeights;
  CostSpace space = CostSpace::kImage;
  LensEstimate estimate = LensEstimate::kMoments;
};
void PrintTo(const Variant& v, std::ostream* out) {
  *out << v.name;
}

class Adjustments : public testing::TestWithParam<Variant> {};

TEST_P(Adjustments, ExactOnDataWithoutNoise) {
  Rng rng(3);
  const Cube cube =
      make_cube({.images = 7, .zooming = GetParam().zooming, .principal_point_spread = 10}, &rng);
  UncalibratedScene scene = perturbed(cube.truth, 0.02, &rng);
  LensAdjustmentOptions options = options_for(GetParam().zooming);
  options.method = GetParam().method;
  options.space = GetParam().space;
  options.estimate = GetParam().estimate;
  const auto summary = GetParam().adjust(cube.tracks, {}, options, &scene);
  ASSERT_TRUE(summary.ok()) << summary.error().message;
  EXPECT_LT(largest_lens_error(scene, cube.truth), 1e-8);
  EXPECT_LT(structure_error(scene.points, cube.truth.points), 1e-9);
  for (size_t i = 1; i < summary->costs.size(); ++i) EXPECT_LE(summary->costs[i], summary->costs[i - 1]);
}

INSTANTIATE_TEST_SUITE_P(
    , Adjustments,
    testing::Values(
        Variant{"free_zoom", adjust_intrinsics_free, true},
        Variant{"free_fixed", adjust_intrinsics_free, false},
        Variant{"free_zoom_multipliers", adjust_intrinsics_free, true, ConstraintMethod::kLagrange},
        Variant{"free_fixed_multipliers", adjust_intrinsics_free, false, ConstraintMethod::kLagrange},
        Variant{"free_zoom_invariant", adjust_intrinsics_free, true, ConstraintMethod::kWeights,
                CostSpace::kInvariant},
        Variant{"least_squares_zoom", adjust_intrinsics_free, true, ConstraintMethod::kWeights,
                CostSpace::kImage, LensEstimate::kLeastSquares},
        Variant{"least_squares_fixed", adjust_intrinsics_free, false, ConstraintMethod::kWeights,
                CostSpace::kImage, LensEstimate::kLeastSquares},
        Variant{"standard_zoom", adjust_standard, true}, Variant{"standard_fixed", adjust_standard, false},
        Variant{"polished_zoom", adjust_polished, true}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(LensAdjustment, MultipliersMeetTheConstraintsInNoise) {
  Rng rng(4);
  Cube cube = make_cube({.images = 8}, &rng);
  add_noise(1.0, &rng, &cube.tracks);
  UncalibratedScene scene = perturbed(cube.truth, 0.01, &rng);
  LensAdjustmentOptions options = options_for(false);
  options.method = ConstraintMethod::kLagrange;
  options.constraint_weight = 100;
  ASSERT_TRUE(adjust_intrinsics_free(cube.tracks, {}, options, &scene).ok());
  for (const Lens& lens : scene.lenses) {
    EXPECT_NEAR(lens.skew, 0, 1e-2);
    EXPECT_NEAR(lens.fx, lens.fy, 1e-2);
    EXPECT_NEAR(lens.fx, scene.lenses[0].fx, 1e-2);
    EXPECT_NEAR(lens.cx, scene.lenses[0].cx, 1e-2);
  }
}

TEST(LensAdjustment, PolishedEndsAtTheMinimumOfStandard) {
  Rng rng(6);
  Cube cube = make_cube({.images = 8}, &rng);
  add_noise(1.0, &rng, &cube.tracks);
  const UncalibratedScene start = perturbed(cube.truth, 0.02, &rng);
  LensAdjustmentOptions options = options_for(false);
  options.lm.min_relative_decrease = 1e-10;
  options.lm.max_iterations = 200;
  UncalibratedScene standard = start, polished = start;
  const auto of_standard = adjust_standard(cube.tracks, {}, options, &standard);
  const auto of_polished = adjust_polished(cube.tracks, {}, options, &polished);
  ASSERT_TRUE(of_standard.ok() && of_polished.ok());
  EXPECT_NEAR(of_polished->lm.final_cost, of_standard->lm.final_cost, 1e-5 * of_standard->lm.final_cost);
  EXPECT_NEAR(polished.lenses[0].fx, standard.lenses[0].fx, 1.0);
}

TEST(LensAdjustment, LossHoldsBackOutliers) {
  Rng rng(7);
  Cube cube = make_cube({.images = 8, .points = 40}, &rng);
  add_noise(0.3, &rng, &cube.tracks);
  for (int k = 0; k < cube.tracks.size(); k += 29) cube.tracks.pixel[k].x() += 8;
  LensAdjustmentOptions options = options_for(false);
  UncalibratedScene plain = cube.truth, robust = cube.truth;
  ASSERT_TRUE(adjust_intrinsics_free(cube.tracks, {}, options, &plain).ok());
  options.loss = {RobustLoss::Kind::kCauchy, 0.5};
  options.reweightings = 6;
  ASSERT_TRUE(adjust_intrinsics_free(cube.tracks, {}, options, &robust).ok());
  EXPECT_LT(structure_error(robust.points, cube.truth.points),
            0.5 * structure_error(plain.points, cube.truth.points));
}

TEST(LensAdjustment, LeavesOutWhatIsSeenTooLittle) {
  Rng rng(8);
  const Cube cube = make_cube({.images = 6, .points = 12}, &rng);
  PointTracks tracks = cube.tracks;
  tracks.point_count = 13;
  tracks.image_count = 7;
  tracks.add(0, 12, {10, 10});  // one image sees the point
  tracks.add(6, 0, {10, 10});   // and one image this point
  UncalibratedScene scene = cube.truth;
  scene.points.emplace_back(1, 2, 3);
  scene.cam_from_world.push_back(scene.cam_from_world[0]);
  scene.lenses.push_back(scene.lenses[0]);
  const auto summary = adjust_intrinsics_free(tracks, {}, options_for(false), &scene);
  ASSERT_TRUE(summary.ok());
  EXPECT_EQ(summary->dropped, 2);
  EXPECT_EQ(scene.points[12], Eigen::Vector3d(1, 2, 3));
  EXPECT_TRUE(std::isinf(summary->lens_sigma[6][0]));
}

std::string message(const Result<LensAdjustmentSummary>& result) {
  return result.ok() ? "" : result.error().message;
}

TEST(LensAdjustment, BadInputIsNamed) {
  Rng rng(9);
  const Cube cube = make_cube({.images = 3, .zooming = true}, &rng);
  UncalibratedScene scene = cube.truth;
  const LensAdjustmentOptions options = options_for(true);
  EXPECT_EQ(
      message(adjust_intrinsics_free(cube.tracks, {}, options, &scene)),
      "images: 3 with at least 6 usable points, at least 4 are needed (known of the lenses: zero skew, unit "
      "aspect ratio)");
  PointTracks twice = cube.tracks;
  twice.add(twice.image[4], twice.point[4], {1, 1});
  EXPECT_EQ(message(adjust_standard(twice, {}, options, &scene)),
            "point tracks: observation 75: image 0, point 4 again, allowed once");
  PointTracks nan = cube.tracks;
  nan.pixel[3].y() = NAN;
  EXPECT_EQ(message(adjust_standard(nan, {}, options, &scene)),
            "point tracks: observation 3: pixel must be two finite numbers");
  PointTracks beyond = cube.tracks;
  beyond.image[2] = 3;
  EXPECT_EQ(message(adjust_standard(beyond, {}, options, &scene)),
            "point tracks: observation 2: image 3, allowed 0 to 2");
  scene.points.pop_back();
  EXPECT_EQ(message(adjust_standard(cube.tracks, {}, options, &scene)),
            "scene: 3 poses, 3 lenses and 24 points, must be 3, as many, and 25");
}

}  // namespace
}  // namespace raysfm
