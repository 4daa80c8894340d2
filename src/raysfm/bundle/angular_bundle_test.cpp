// The adjustment under the angular error (LBA09 3.2, 3.3).
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/bundle/covariance.h"
#include "raysfm/bundle/resection.h"
#include "raysfm/bundle/residual.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

using test::BundleScene;
using test::make_bundle_scene;

double most_pose_distance(const BundleScene& a, const BundleScene& b) {
  double most = 0;
  for (size_t i = 0; i < a.poses.size(); ++i) {
    most = std::max(most, (a.poses[i].translation - b.poses[i].translation).norm());
  }
  return most;
}

const BundleOptions kToTheEnd{.max_iterations = 60, .min_relative_decrease = 1e-12};

TEST(AngularBundle, ExactRaysGiveTheTruth) {
  for (const AngularWeight weight : {AngularWeight::kNone, AngularWeight::kPixel}) {
    BundleScene scene = make_bundle_scene({.noise_px = 0});
    test::observe_rays(&scene, weight);
    BundleAdjuster adjuster;
    EXPECT_LT(adjuster.adjust(scene.problem(), kToTheEnd).final_cost, 1e-12);
    for (size_t i = 0; i < scene.poses.size(); ++i) {
      EXPECT_LT((scene.poses[i].translation - scene.true_poses[i].translation).norm(), 1e-6);
    }
  }
}

// The optimum moves by far less than the noise moves it; whitened less than plain, which weights the pixels
// at the border otherwise.
TEST(AngularBundle, PixelAndAngleReachTheSameOptimum) {
  BundleScene pixel = make_bundle_scene({}), plain = pixel, whitened = pixel;
  test::observe_rays(&plain, AngularWeight::kNone);
  test::observe_rays(&whitened, AngularWeight::kPixel);
  BundleAdjuster adjuster;
  const BundleSummary by_pixel = adjuster.adjust(pixel.problem(), kToTheEnd);
  adjuster.adjust(plain.problem(), kToTheEnd);
  const BundleSummary by_angle = adjuster.adjust(whitened.problem(), kToTheEnd);
  double by_noise = 0;
  for (int i = 7; i < 10; ++i) {
    by_noise = std::max(by_noise, (pixel.poses[i].translation - pixel.true_poses[i].translation).norm());
  }
  EXPECT_GT(by_noise, 1e-4);
  EXPECT_LT(most_pose_distance(plain, pixel), by_noise);
  EXPECT_LT(most_pose_distance(whitened, pixel), 0.05 * by_noise);
  EXPECT_NEAR(by_angle.final_cost, by_pixel.final_cost, 1e-3 * by_pixel.final_cost);
}

TEST(AngularBundle, StopsWhereTheGradientVanishes) {
  BundleScene scene = make_bundle_scene({.points = 100});
  test::observe_rays(&scene, AngularWeight::kPixel);
  BundleAdjuster adjuster;
  adjuster.adjust(scene.problem(), kToTheEnd);
  const auto cost = [&] {
    const BundleProblem problem = scene.problem();
    double sum = 0;
    for (size_t i = 0; i < scene.observations.size(); ++i) {
      Eigen::Vector2d r;
      EXPECT_TRUE(residual_of(problem, static_cast<int>(i), &r));
      sum += 0.5 * r.squaredNorm();
    }
    return sum;
  };
  for (int k = 0; k < 6; ++k) {
    const Rigid3 pose = scene.poses[8];
    const Eigen::Matrix<double, 6, 1> step = 1e-6 * Eigen::Matrix<double, 6, 1>::Unit(k);
    scene.poses[8] = retract(pose, step);
    const double plus = cost();
    scene.poses[8] = retract(pose, -step);
    const double minus = cost();
    scene.poses[8] = pose;
    EXPECT_NEAR((plus - minus) / 2e-6, 0, 0.05);
  }
}

TEST(AngularBundle, BehindTheRayIsDroppedAndCounted) {
  BundleScene scene = make_bundle_scene({});
  test::observe_rays(&scene, AngularWeight::kPixel);
  scene.points[3] = scene.true_poses[0].inverse() * Eigen::Vector3d(0, 0, -100);
  int sightings = 0;
  for (const BundleObservation& o : scene.observations) sightings += o.point == 3;
  BundleAdjuster adjuster;
  const BundleSummary summary = adjuster.adjust_two_stage(scene.problem(), {}, 4.0);
  EXPECT_EQ(adjuster.adjust(scene.problem(), {}).dropped_observations, 0);
  EXPECT_EQ(summary.used_observations + sightings, static_cast<int>(scene.observations.size()));
  for (size_t i = 0; i < scene.observations.size(); ++i) {
    EXPECT_EQ(scene.is_inlier[i] == 0, scene.observations[i].point == 3);
  }
}

// A camera that looks backwards has no projection in common with one that looks ahead, but rays like any
// other.
TEST(AngularBundle, RaysThatAreNotCentral) {
  Rng rng(8);
  BundleScene scene = make_bundle_scene({.poses = 4, .free_poses = 2, .points = 80, .track = 4});
  scene.observations.clear(), scene.cameras.clear();
  for (int p = 0; p < 80; ++p) {
    scene.true_points[p] = test::random_vector(rng, 5.0);
    scene.points[p] = scene.true_points[p] + test::random_vector(rng, 0.05);
    for (int i = 0; i < 4; ++i) {
      ObservedRay ray;
      ray.origin = test::random_vector(rng, 0.2);
      ray.direction = (scene.true_poses[i] * scene.true_points[p] - ray.origin).normalized();
      ray.tangents = rotation_to_z(ray.direction).topRows<2>();
      scene.rays.push_back(ray);
      scene.observations.push_back({i, p, 0, Eigen::Vector2d::Zero()});
    }
  }
  scene.is_inlier.assign(scene.observations.size(), 1);
  BundleAdjuster adjuster;
  EXPECT_LT(adjuster.adjust(scene.problem(), kToTheEnd).final_cost, 1e-20);
  for (int i = 2; i < 4; ++i) {
    EXPECT_LT((scene.poses[i].translation - scene.true_poses[i].translation).norm(), 1e-7);
  }
  // Origins apart show the scale: nothing fixed, six directions are free, not seven.
  scene.pose_is_free.assign(4, 1);
  const Result<BundleCovariance> covariance = bundle_covariance(scene.problem(), {}, 1e-3);
  ASSERT_TRUE(covariance);
  EXPECT_EQ(covariance->gauge_freedoms, 6);
}

TEST(AngularBundle, ResectionAndIntersection) {
  BundleScene scene =
      make_bundle_scene({.poses = 5, .free_poses = 5, .points = 120, .noise_px = 0, .point_error = 0});
  test::observe_rays(&scene, AngularWeight::kPixel);
  BundleAdjuster adjuster;
  EXPECT_LT(resect(scene.problem(), kToTheEnd, &adjuster).final_cost, 1e-15);
  Rng rng(2);
  for (Eigen::Vector3d& x : scene.points) x += test::random_vector(rng, 0.1);
  const std::vector<Rigid3> poses = scene.poses;
  EXPECT_LT(intersect(scene.problem(), kToTheEnd, &adjuster).final_cost, 1e-15);
  for (size_t i = 0; i < poses.size(); ++i) EXPECT_EQ(scene.poses[i].translation, poses[i].translation);
}

TEST(AngularBundle, ContradictionsAreRefused) {
  BundleScene scene = make_bundle_scene({.points = 20});
  test::observe_rays(&scene, AngularWeight::kPixel);
  scene.rays.pop_back();
  BundleAdjuster adjuster;
  EXPECT_EQ(adjuster.adjust(scene.problem(), {}).termination, Termination::kInvalidProblem);
}

TEST(AngularBundle, HugeAndNanRaysDoNoHarm) {
  BundleAdjuster adjuster;
  for (const double value : {double(NAN), double(INFINITY), 1e308, 0.0}) {
    for (int where = 0; where < 3; ++where) {
      BundleScene scene = make_bundle_scene({.points = 60});
      test::observe_rays(&scene, AngularWeight::kPixel);
      ObservedRay& ray = scene.rays[7];
      (where == 0 ? ray.origin : ray.direction).y() = value;
      if (where == 2) ray.tangents(1, 1) = value;
      const BundleSummary summary = adjuster.adjust_two_stage(scene.problem(), {}, 4.0);
      EXPECT_TRUE(std::isfinite(summary.final_cost));
      EXPECT_TRUE(scene.poses[9].translation.allFinite());
    }
  }
}

}  // namespace
}  // namespace raysfm
