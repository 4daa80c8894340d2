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

// The pixels of a cube's lenses with a distortion.
PointTracks distorted(const Cube& cube, const RadialDistortion& radial) {
  PointTracks tracks = cube.tracks;
  for (int k = 0; k < tracks.size(); ++k) tracks.pixel[k] += pixel_residual(tracks, cube.truth, radial, k);
  return tracks;
}

TEST(LensAdjustment, DistortionIsAnUnknownBesideTheLens) {
  Rng rng(17);
  const Cube cube = make_cube({.images = 8, .points = 40}, &rng);
  const RadialDistortion truth{-0.2, 0.6};
  const PointTracks tracks = distorted(cube, truth);
  LensAdjustmentOptions options;
  options.constraints.equal = true;
  options.lm.min_relative_decrease = 1e-12;
  for (const int terms : {1, 2}) {
    options.radial_terms = terms;
    options.radial = {0, terms == 1 ? truth.k2 : 0};  // held at the truth, or unknown
    UncalibratedScene scene = perturbed(cube.truth, 0.01, &rng);
    const auto summary = adjust_standard(tracks, {}, options, &scene);
    ASSERT_TRUE(summary.ok()) << summary.error().message;
    EXPECT_NEAR(summary->radial.k1, truth.k1, 1e-6) << terms;
    EXPECT_NEAR(summary->radial.k2, truth.k2, 1e-4) << terms;
    EXPECT_NEAR(scene.lenses[3].fx, cube.truth.lenses[3].fx, 1e-3) << terms;
    EXPECT_LT(summary->rms_px, 1e-6);
  }
}

// An influence is the derivative of the lens by the logarithm of the weight of a point's observations.
TEST(LensAdjustment, InfluenceOfAPointIsWhatItsWeightChanges) {
  constexpr double kStep = 0.02;
  Rng rng(19);
  const Cube cube = make_cube({.images = 8, .points = 30}, &rng);
  PointTracks tracks = distorted(cube, {-0.2, 0.6});
  add_noise(0.05, &rng, &tracks);
  LensAdjustmentOptions options;
  options.constraints.equal = true;
  options.radial_terms = 2;
  options.with_influence = true;
  options.lm.min_relative_decrease = 1e-14;
  UncalibratedScene scene = cube.truth;
  const auto at = adjust_standard(tracks, {}, options, &scene);
  ASSERT_TRUE(at.ok());
  ASSERT_EQ(at->influence.cols(), tracks.point_count);
  const auto lens_with = [&](int point, double factor) {
    std::vector<double> weights(tracks.size(), 1);
    for (int k = 0; k < tracks.size(); ++k) weights[k] = tracks.point[k] == point ? factor : 1;
    UncalibratedScene moved = scene;
    LensAdjustmentOptions from_here = options;
    from_here.radial = at->radial;
    const auto summary = adjust_standard(tracks, weights, from_here, &moved);
    EXPECT_TRUE(summary.ok());
    Eigen::Matrix<double, 7, 1> numbers;
    numbers << moved.lenses[0].vector(), summary->radial.k1, summary->radial.k2;
    return numbers;
  };
  const Eigen::Matrix<double, 7, 1> typical =
      at->influence.rowwise().norm() / std::sqrt(double(tracks.point_count));
  for (const int point : {0, 7, 21}) {
    const Eigen::Matrix<double, 7, 1> change =
        (lens_with(point, 1 + kStep) - lens_with(point, 1 - kStep)) / (2 * kStep);
    for (const int number : {0, 1, 2, 3, 5, 6}) {
      EXPECT_NEAR(at->influence(number, point), change[number], 0.05 * typical[number])
          << point << ' ' << number;
    }
  }
}

TEST(LensAdjustment, OneLensIsThatOfImagesThatAreNotAdjusted) {
  Rng rng(23);
  const Cube cube = make_cube({.images = 7, .points = 30}, &rng);
  std::vector<double> weights(cube.tracks.size(), 1);
  for (int k = 0; k < cube.tracks.size(); ++k) weights[k] = cube.tracks.image[k] == 4 ? 0 : 1;
  UncalibratedScene scene = perturbed(cube.truth, 0.01, &rng);
  LensAdjustmentOptions options;
  options.constraints.equal = true;
  ASSERT_TRUE(adjust_standard(cube.tracks, weights, options, &scene).ok());
  EXPECT_EQ(scene.lenses[4].vector(), scene.lenses[0].vector());
}

TEST(LensAdjustment, DistortionOfLensesOfTheirOwnIsRefused) {
  Rng rng(29);
  const Cube cube = make_cube({.images = 7, .points = 30, .zooming = true}, &rng);
  UncalibratedScene scene = cube.truth;
  LensAdjustmentOptions options;
  options.radial_terms = 1;
  const auto summary = adjust_standard(cube.tracks, {}, options, &scene);
  ASSERT_FALSE(summary.ok());
  EXPECT_EQ(summary.error().kind, ErrorKind::kBadInput);
}

// Said to be one, the lenses of all images end where one lens for all does.
TEST(LensAdjustment, LensesThatImagesShareAreOne) {
  Rng rng(21);
  Cube cube = make_cube({.images = 8}, &rng);
  add_noise(1.0, &rng, &cube.tracks);
  const UncalibratedScene start = perturbed(cube.truth, 0.01, &rng);
  LensAdjustmentOptions options = options_for(true);
  options.constraints.principal_point = cube.tracks.centre();
  options.constraints.principal_point_sigma = 0;
  options.lm = {.max_iterations = 200, .min_relative_decrease = 1e-12};
  const std::vector<int> numbers(8, 3);
  options.lens_of_image = numbers;
  UncalibratedScene by_numbers = start, equal = start;
  const auto shared = adjust_standard(cube.tracks, {}, options, &by_numbers);
  const auto one = adjust_standard(cube.tracks, {}, options_for(false), &equal);
  ASSERT_TRUE(shared.ok() && one.ok());
  for (int j = 0; j < 8; ++j) {
    EXPECT_EQ(by_numbers.lenses[j].vector(), by_numbers.lenses[0].vector());
    EXPECT_NEAR(by_numbers.lenses[j].fx, equal.lenses[0].fx, 0.02 * one->lens_sigma[0][0]);
    EXPECT_NEAR(by_numbers.lenses[j].cx, equal.lenses[0].cx, 0.02 * one->lens_sigma[0][2]);
    EXPECT_NEAR(shared->lens_sigma[j][0] / one->lens_sigma[0][0], 1, 0.01);
  }
}

TEST(LensAdjustment, TwoLensesAreToldBetterThanOneForEachImage) {
  Rng rng(22);
  Cube cube = make_cube({.images = 8}, &rng);
  std::vector<int> numbers;
  for (int j = 0; j < 8; ++j) {
    numbers.push_back(j % 3 == 0);
    if (numbers[j] == 1) cube.truth.lenses[j] = {1500, 1500, 262, 240, 0};
  }
  test_scenes::project_all(cube.truth, &cube.tracks);
  add_noise(1.0, &rng, &cube.tracks);
  UncalibratedScene apart = perturbed(cube.truth, 0.01, &rng), shared = apart;
  LensAdjustmentOptions options = options_for(true);
  ASSERT_TRUE(adjust_standard(cube.tracks, {}, options, &apart).ok());
  options.lens_of_image = numbers;
  const auto summary = adjust_standard(cube.tracks, {}, options, &shared);
  ASSERT_TRUE(summary.ok());
  EXPECT_LT(largest_lens_error(shared, cube.truth), 0.5 * largest_lens_error(apart, cube.truth));
  for (int j = 0; j < 8; ++j) {
    EXPECT_EQ(shared.lenses[j].vector(), shared.lenses[numbers[j] == 1 ? 0 : 1].vector());
    EXPECT_LT(std::abs(shared.lenses[j].fx - cube.truth.lenses[j].fx), 4 * summary->lens_sigma[j][0]);
  }
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
  LensAdjustmentOptions numbered = options;
  const std::vector<int> numbers(2, 0);
  numbered.lens_of_image = numbers;
  EXPECT_EQ(message(adjust_standard(cube.tracks, {}, numbered, &scene)),
            "lens_of_image: 2, allowed 0 or 3, the number of images");
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
