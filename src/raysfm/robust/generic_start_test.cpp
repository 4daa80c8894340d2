#include "raysfm/robust/generic_start.h"

#include <gtest/gtest.h>

#include <limits>

#include "raysfm/robust/rig_refinement.h"
#include "support/pose_errors.h"
#include "support/rig_test_scenes.h"

namespace raysfm {
namespace {

using testing_support::kDegree;

using namespace rig_scenes;
using Eigen::Vector3d;

class GenericStartScenes : public testing::TestWithParam<std::tuple<Kind, Motion, double>> {};

// Even among the cameras, or most points in one.
TEST_P(GenericStartScenes, FindTheMotion) {
  const auto [kind, motion, main_share] = GetParam();
  constexpr int kTrials = 5;
  for (int trial = 0; trial < kTrials; ++trial) {
    Rng rng(trial, 1);
    const Scene scene = make_scene({kind, motion, 300, 0.5, 0.3, main_share}, rng);
    GenericStartOptions options;
    options.seed = trial;
    const GenericStart start = start_generic(scene.matches(), options);
    ASSERT_TRUE(start.ok()) << describe(start);
    const MotionError error = motion_error(scene, start.rig1_from_rig0, start.rig2_from_rig0);
    EXPECT_LT(error.rotation, 0.3 * kDegree);
    EXPECT_LT(error.direction, 3 * kDegree);
    int wrong = 0;
    for (size_t i = 0; i < scene.outlier.size(); ++i) wrong += start.inlier[i] == scene.outlier[i];
    EXPECT_LE(wrong, 12);
    // What is told of the scale has to be true, and without rotation only rays of several cameras tell it.
    if (start.scale_known) {
      EXPECT_NEAR(error.scale, 1, 2.5 / start.scale_significance);
    }
    if (kind == Kind::kStereoCross) {
      EXPECT_TRUE(start.scale_known);
    }
    if (motion == Motion::kPureTranslation) {
      EXPECT_EQ(start.scale_known, kind == Kind::kStereoCross);
    }
    if (kind == Kind::kRing4 && motion == Motion::kRotation) {
      EXPECT_TRUE(start.scale_known);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, GenericStartScenes,
                         testing::Combine(testing::Values(Kind::kCentral, Kind::kStereo, Kind::kStereoCross,
                                                          Kind::kRing3, Kind::kRing4, Kind::kMirror),
                                          testing::Values(Motion::kForward, Motion::kRotation,
                                                          Motion::kPureTranslation),
                                          testing::Values(0.0, 0.8)));

TEST(GenericStart, ChoosesItsMethodByTheRays) {
  for (const auto& [kind, method] : {std::pair(Kind::kCentral, GenericStartMethod::kCentral),
                                     std::pair(Kind::kStereoCross, GenericStartMethod::kStereoPoints),
                                     std::pair(Kind::kRing3, GenericStartMethod::kFivePoints),
                                     std::pair(Kind::kMirror, GenericStartMethod::kFivePoints)}) {
    Rng rng(1, 2);
    const Scene scene = make_scene({kind, Motion::kForward}, rng);
    EXPECT_EQ(start_generic(scene.matches(), {}).method, method);
  }
}

TEST(GenericStart, ThePapersMethodFindsTheMotionToo) {
  for (const Kind kind : {Kind::kStereo, Kind::kRing3, Kind::kRing4}) {
    Rng rng(3, 3);
    const Scene scene = make_scene({kind, Motion::kRotation, 300, 0.5, 0.05}, rng);
    GenericStartOptions options;
    options.method = GenericStartMethod::kSeventeenPoint;
    const GenericStart start = start_generic(scene.matches(), options);
    ASSERT_TRUE(start.ok()) << describe(start);
    EXPECT_EQ(start.method, GenericStartMethod::kSeventeenPoint);
    const MotionError error = motion_error(scene, start.rig1_from_rig0, start.rig2_from_rig0);
    EXPECT_LT(error.rotation, 0.3 * kDegree);
    EXPECT_NEAR(error.scale, 1, 0.15);
  }
}

TEST(GenericStart, ExactRaysGiveTheExactMotionAndPoints) {
  for (const Kind kind : {Kind::kStereo, Kind::kStereoCross, Kind::kRing3, Kind::kMirror}) {
    Rng rng(4, 4);
    const Scene scene = make_scene({kind, Motion::kRotation, 200, 0, 0}, rng);
    const GenericStart start = start_generic(scene.matches(), {});
    ASSERT_TRUE(start.ok()) << describe(start);
    EXPECT_TRUE(start.scale_known);
    EXPECT_EQ(start.inlier_count, 200);
    const MotionError error = motion_error(scene, start.rig1_from_rig0, start.rig2_from_rig0);
    EXPECT_LT(error.rotation, 1e-5);
    EXPECT_NEAR(error.scale, 1, 1e-3);
    for (size_t i = 0; i < scene.points_in_rig0.size(); ++i) {
      EXPECT_LT((start.points_in_rig0[i] - scene.points_in_rig0[i]).norm(),
                5e-3 * scene.points_in_rig0[i].norm());
    }
  }
}

// Without a scale the centre of the camera with most points moves by one unit.
TEST(GenericStart, AnUnknownScaleIsOne) {
  Rng rng(5, 5);
  const Scene scene = make_scene({Kind::kRing3, Motion::kPureTranslation, 300, 0.5, 0.2, 0.6}, rng);
  const GenericStart start = start_generic(scene.matches(), {});
  ASSERT_TRUE(start.ok());
  EXPECT_FALSE(start.scale_known);
  const Vector3d& c = scene.centre_in_rig;
  EXPECT_NEAR((start.rig2_from_rig0 * c - c).norm(), 1, 1e-6);
  EXPECT_NE(describe(start).find("not observable"), std::string::npos);
}

TEST(GenericStart, SaysWhyItFails) {
  Rng rng(6, 6);
  Scene scene = make_scene({Kind::kRing3, Motion::kForward, 20}, rng);
  EXPECT_EQ(start_generic(scene.matches(), {}).problem, StartProblem::kTooFewMatches);
  scene = make_scene({Kind::kRing3, Motion::kForward, 200, 0.5, 1.0}, rng);
  EXPECT_EQ(start_generic(scene.matches(), {}).problem, StartProblem::kTooFewInliers);

  // Far points and a turning rig.
  scene = make_scene({Kind::kRing3, Motion::kRotation, 200, 0, 0}, rng);
  const std::array<Rigid3, 3> poses = {Rigid3{}, scene.rig1_from_rig0, scene.rig2_from_rig0};
  for (size_t i = 0; i < scene.rays.size(); ++i) {
    const Vector3d far = 1e5 * scene.points_in_rig0[scene.points[i]];
    scene.rays[i] = observe(Kind::kRing3, {Eigen::Quaterniond::Identity(), scene.rays[i].origin},
                            poses[scene.views[i]] * far, 0.5 / kFocal, rng);
  }
  EXPECT_EQ(start_generic(scene.matches(), {}).problem, StartProblem::kRotationOnly);

  // A rig that stands still.
  for (size_t i = 0; i < scene.rays.size(); ++i) scene.rays[i] = scene.rays[i / 3 * 3];
  EXPECT_EQ(start_generic(scene.matches(), {}).problem, StartProblem::kNoMotion);
}

TEST(GenericStart, BadInputIsLeftOut) {
  Rng rng(7, 7);
  Scene scene = make_scene({Kind::kRing3, Motion::kRotation, 200}, rng);
  scene.points[0] = -1;
  scene.points[3] = 200;
  scene.views[6] = 3;
  scene.cameras[9] = -2;
  scene.rays[12].direction.x() = std::numeric_limits<double>::quiet_NaN();
  scene.rays[15].origin.y() = std::numeric_limits<double>::infinity();
  const GenericStart start = start_generic(scene.matches(), {});
  ASSERT_TRUE(start.ok()) << describe(start);
  for (int i = 0; i < 6; ++i) EXPECT_FALSE(start.inlier[i]);
  EXPECT_GT(start.inlier_count, 180);
  scene.views.pop_back();
  EXPECT_EQ(start_generic(scene.matches(), {}).problem, StartProblem::kTooFewMatches);
  EXPECT_EQ(start_generic({-5, {}, {}, {}}, {}).problem, StartProblem::kTooFewMatches);
}

TEST(GenericStart, SameSeedSameBitsAndTheOrderOfTheRaysDoesNotMatter) {
  Rng rng(8, 8);
  Scene scene = make_scene({Kind::kStereoCross, Motion::kForward, 150}, rng);
  const GenericStart one = start_generic(scene.matches(), {});
  std::reverse(scene.rays.begin(), scene.rays.end());
  std::reverse(scene.points.begin(), scene.points.end());
  std::reverse(scene.views.begin(), scene.views.end());
  std::reverse(scene.cameras.begin(), scene.cameras.end());
  const GenericStart two = start_generic(scene.matches(), {});
  EXPECT_EQ(one.rig2_from_rig0.translation, two.rig2_from_rig0.translation);
  EXPECT_EQ(one.rig2_from_rig0.rotation.coeffs(), two.rig2_from_rig0.rotation.coeffs());
  EXPECT_EQ(one.inlier, two.inlier);
  EXPECT_EQ(one.scale_significance, two.scale_significance);
}

// The minimum of the refinement is one: no small step of the twelve parameters, the points following, lowers
// the cost.
TEST(RigRefinement, ArrivesAtAMinimum) {
  Rng rng(9, 9);
  const Scene scene = make_scene({Kind::kRing3, Motion::kRotation, 100}, rng);
  const RigTable table = make_rig_table(scene.matches());
  std::vector<int> all(table.size());
  for (int i = 0; i < table.size(); ++i) all[i] = i;
  const auto about_centre = [&](const Rigid3& pose) {
    return Rigid3{pose.rotation, pose.translation + pose.rotation * table.centre - table.centre};
  };
  RigMotion motion{about_centre(scene.rig1_from_rig0), about_centre(scene.rig2_from_rig0)};
  RigRefiner refiner;
  constexpr RigRefiner::Options kAll{.max_iterations = 100, .min_decrease = 1e-12};
  const RigMotion truth = motion;
  const double at_truth = refiner.refine(table, all, {.max_iterations = 1, .min_decrease = 1}, &motion);
  const double least = refiner.refine(table, all, kAll, &motion);
  EXPECT_LT(least, at_truth);
  // The sum of squares of 2 x 300 residuals with 312 parameters and half a pixel of noise.
  EXPECT_NEAR(least / 0.25, 600 - 312, 5 * std::sqrt(2.0 * 288));
  for (int k = 0; k < 12; ++k) {
    Eigen::Matrix<double, 6, 1> step = Eigen::Matrix<double, 6, 1>::Zero();
    step[k % 6] = 0.02;
    RigMotion away = motion;
    Rigid3& pose = k < 6 ? away.rig1_from_rig0 : away.rig2_from_rig0;
    pose = retract(pose, step);
    EXPECT_GE(refiner.refine(table, all, kAll, &away), (1 - 1e-9) * least);
    EXPECT_LT((away.rig2_from_rig0.translation - motion.rig2_from_rig0.translation).norm(), 1e-4);
  }
  RigMotion held{truth.rig1_from_rig0, truth.rig2_from_rig0};
  const double length = held.rig2_from_rig0.translation.norm();
  const double with_scale =
      refiner.refine(table, all, {.max_iterations = 100, .min_decrease = 1e-12, .hold_scale = true}, &held);
  EXPECT_NEAR(held.rig2_from_rig0.translation.norm(), length, 1e-12);
  EXPECT_GE(with_scale, least);
}

}  // namespace
}  // namespace raysfm
