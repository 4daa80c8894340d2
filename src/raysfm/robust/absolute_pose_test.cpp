#include "raysfm/robust/absolute_pose.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <tuple>

#include "raysfm/camera/observed_ray.h"
#include "raysfm/core/random.h"
#include "support/pose_errors.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;
using testing_support::rotation_error;

using Eigen::Vector2d;
using Eigen::Vector3d;

Camera pinhole_camera() {
  Camera camera;
  camera.name = "cam0";
  camera.model = Pinhole{500, 510, 320, 240};
  camera.width = 640, camera.height = 480;
  return camera;
}

Rig mono() {
  return {{pinhole_camera()}};
}

// Three cameras that look in different directions, with different centres.
Rig three_cameras() {
  Rig rig;
  for (int i = 0; i < 3; ++i) {
    Camera camera = pinhole_camera();
    camera.rig_from_cam = {exp_so3(Vector3d(0.1, 2.1 * i, 0.05 * i)), Vector3d(0.3 * i, -0.1, 0.2 * i)};
    rig.cameras.push_back(camera);
  }
  return rig;
}

struct PoseScene {
  Rig rig;
  Rigid3 rig_from_world;
  std::vector<Vector3d> points = {};
  std::vector<Vector2d> pixels = {};
  std::vector<int> cameras = {};
  std::vector<ObservedRay> rays = {};
  std::vector<float> sigmas = {};

  PoseObservations observations() const { return {points, pixels, cameras, rays, sigmas}; }

  // Leaves the rays alone to be known of the observations: a camera that cannot project. Where `offsets` is
  // not empty, no two rays share an origin.
  void keep_rays_alone(const std::vector<Vector3d>& offsets = {}) {
    rays.resize(points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      if (!observe_ray(rig.cameras[cameras[i]], pixels[i], AngularWeight::kPixel, &rays[i])) {
        rays[i].direction.setConstant(std::numeric_limits<double>::quiet_NaN());
      }
      if (!offsets.empty()) rays[i].origin += offsets[i];
    }
  }
};

// Points 3 to 20 units before the cameras in turn, `noise` pixels on each coordinate, the first
// `outliers` pixels anywhere in the image.
PoseScene make_pose_scene(const Rig& rig, int count, double noise, double outliers, Rng& rng) {
  PoseScene scene{.rig = rig, .rig_from_world = {exp_so3(normal_vector(rng)), 10 * normal_vector(rng)}};
  const Rigid3 world_from_rig = scene.rig_from_world.inverse();
  for (int i = 0; i < count; ++i) {
    const int c = i % static_cast<int>(rig.cameras.size());
    const Camera& camera = rig.cameras[c];
    const Vector2d pixel(rng.uniform(0, 640), rng.uniform(0, 480));
    Ray ray;
    EXPECT_TRUE(camera.ray(pixel, &ray));
    const Vector3d in_rig = camera.rig_from_cam * Vector3d(rng.uniform(3, 20) * ray.direction);
    scene.points.push_back(world_from_rig * in_rig);
    scene.pixels.push_back(pixel + noise * Vector2d(rng.normal(), rng.normal()));
    if (i < outliers * count) scene.pixels.back() = {rng.uniform(0, 640), rng.uniform(0, 480)};
    scene.cameras.push_back(c);
  }
  return scene;
}

double position_error(const Rigid3& a, const Rigid3& b) {
  return (a.inverse().translation - b.inverse().translation).norm();
}

TEST(PoseResiduals, JacobianIsTheDerivative) {
  Rng rng(1);
  const PoseScene scene = make_pose_scene(three_cameras(), 30, 2, 0, rng);
  const PoseObservations observations = scene.observations();
  PoseResiduals residuals;
  residuals.load(scene.rig, observations);
  for (int i = 0; i < 30; ++i) {
    Vector2d r, plus, minus;
    PoseResiduals::Jacobian jacobian, unused;
    ASSERT_TRUE(residuals.evaluate(scene.rig_from_world, i, &r, &jacobian));
    for (int k = 0; k < 6; ++k) {
      constexpr double kStep = 1e-6;
      const Vector6d delta = kStep * Vector6d::Unit(k);
      ASSERT_TRUE(residuals.evaluate(retract(scene.rig_from_world, delta), i, &plus, &unused));
      ASSERT_TRUE(residuals.evaluate(retract(scene.rig_from_world, -delta), i, &minus, &unused));
      const Vector2d numeric = (plus - minus) / (2 * kStep);
      EXPECT_LT((numeric - jacobian.col(k)).norm(), 1e-4 * (1 + numeric.norm()));
    }
  }
}

// Moves the rays of a scene, and the points with them, apart.
std::vector<Vector3d> make_non_central(PoseScene* scene, Rng& rng) {
  std::vector<Vector3d> offsets;
  const Rigid3 world_from_rig = scene->rig_from_world.inverse();
  for (Vector3d& point : scene->points) {
    offsets.push_back(0.2 * normal_vector(rng));
    point += world_from_rig.rotation * offsets.back();
  }
  return offsets;
}

TEST(PoseResiduals, OfRaysAreThoseOfPixelsForASmallError) {
  Rng rng(11);
  PoseScene scene = make_pose_scene(three_cameras(), 30, 0.05, 0, rng);
  const PoseObservations pixels = scene.observations();
  PoseResiduals pixel_residuals;
  pixel_residuals.load(scene.rig, pixels);
  PoseScene seen = scene;
  seen.keep_rays_alone();
  const PoseObservations rays{seen.points, {}, {}, seen.rays};
  const Rig no_rig;
  PoseResiduals ray_residuals;
  ray_residuals.load(no_rig, rays);
  for (int i = 0; i < 30; ++i) {
    Vector2d by_pixel, by_ray;
    PoseResiduals::Jacobian jacobian, ray_jacobian;
    ASSERT_TRUE(pixel_residuals.evaluate(scene.rig_from_world, i, &by_pixel, &jacobian));
    ASSERT_TRUE(ray_residuals.evaluate(scene.rig_from_world, i, &by_ray, &ray_jacobian));
    EXPECT_LT((by_pixel - by_ray).norm(), 1e-3);
    EXPECT_LT((jacobian - ray_jacobian).norm(), 2e-3 * jacobian.norm());
  }
}

enum class Sight { kOneCamera, kThreeCameras, kRaysOfThree, kNonCentral };

class PoseOfRig : public testing::TestWithParam<std::tuple<Sight, double>> {};

TEST_P(PoseOfRig, IsFoundAmongOutliers) {
  const auto [sight, outliers] = GetParam();
  PoseEstimator estimator;
  PoseEstimate estimate;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    Rng rng(seed, 2);
    PoseScene scene =
        make_pose_scene(sight == Sight::kOneCamera ? mono() : three_cameras(), 300, 0.5, outliers, rng);
    if (sight == Sight::kRaysOfThree) scene.keep_rays_alone();
    if (sight == Sight::kNonCentral) scene.keep_rays_alone(make_non_central(&scene, rng));
    PoseOptions options;
    options.seed = seed;
    estimator.estimate(scene.rig, scene.observations(), nullptr, options, &estimate);
    ASSERT_TRUE(estimate.ok());
    EXPECT_LT(rotation_error(estimate.rig_from_world, scene.rig_from_world), 2e-3);
    EXPECT_LT(position_error(estimate.rig_from_world, scene.rig_from_world), 0.03);
    EXPECT_NEAR(estimate.inlier_count, 300 * (1 - outliers), 6);
    int wrong = 0, marked = 0;
    for (int i = 0; i < 300; ++i) {
      marked += estimate.inlier[i];
      wrong += (estimate.inlier[i] != 0) == (i < outliers * 300);
    }
    EXPECT_EQ(marked, estimate.inlier_count);
    EXPECT_LE(wrong, 6);
    EXPECT_NEAR(estimate.sigma_px, 0.5, 0.1);
  }
}

INSTANTIATE_TEST_SUITE_P(Outliers, PoseOfRig,
                         testing::Combine(testing::Values(Sight::kOneCamera, Sight::kThreeCameras,
                                                          Sight::kRaysOfThree, Sight::kNonCentral),
                                          testing::Values(0.0, 0.3, 0.7)));

// LBA09 4.5: five rays adjusted from the pose of the frame before.
TEST(AbsolutePose, FiveRaysFromTheLastPose) {
  PoseEstimator estimator;
  PoseEstimate estimate;
  for (uint64_t seed = 0; seed < 10; ++seed) {
    Rng rng(seed, 12);
    PoseScene scene = make_pose_scene(three_cameras(), 200, 0.5, 0.3, rng);
    scene.keep_rays_alone(make_non_central(&scene, rng));
    const Rigid3 last{exp_so3(0.05 * normal_vector(rng)) * scene.rig_from_world.rotation,
                      scene.rig_from_world.translation + 0.2 * normal_vector(rng)};
    PoseOptions options;
    options.method = PoseMethod::kFiveRays;
    options.seed = seed;
    estimator.estimate(scene.rig, scene.observations(), &last, options, &estimate);
    ASSERT_TRUE(estimate.ok());
    EXPECT_LT(rotation_error(estimate.rig_from_world, scene.rig_from_world), 2e-3);
    EXPECT_LT(position_error(estimate.rig_from_world, scene.rig_from_world), 0.03);
  }
}

TEST(AbsolutePose, ExactDataGiveTheExactPose) {
  Rng rng(3);
  const PoseScene scene = make_pose_scene(mono(), 100, 0, 0, rng);
  PoseEstimator estimator;
  PoseEstimate estimate;
  estimator.estimate(scene.rig, scene.observations(), nullptr, {}, &estimate);
  ASSERT_TRUE(estimate.ok());
  EXPECT_EQ(estimate.inlier_count, 100);
  EXPECT_LT(rotation_error(estimate.rig_from_world, scene.rig_from_world), 1e-8);
  EXPECT_LT(position_error(estimate.rig_from_world, scene.rig_from_world), 1e-6);
}

TEST(AbsolutePose, AGoodPriorSavesTheSamplesAndABadOneDoesNoHarm) {
  Rng rng(4);
  const PoseScene scene = make_pose_scene(mono(), 400, 0.5, 0.2, rng);
  PoseEstimator estimator;
  PoseEstimate without, with_good, with_bad;
  estimator.estimate(scene.rig, scene.observations(), nullptr, {}, &without);
  Vector6d nudge = Vector6d::Constant(1e-3);
  const Rigid3 good = retract(scene.rig_from_world, nudge), bad{exp_so3({1, 1, 1}), {100, 0, 0}};
  estimator.estimate(scene.rig, scene.observations(), &good, {}, &with_good);
  estimator.estimate(scene.rig, scene.observations(), &bad, {}, &with_bad);
  ASSERT_TRUE(without.ok() && with_good.ok() && with_bad.ok());
  EXPECT_GT(without.iterations, 0);
  EXPECT_EQ(with_good.iterations, 0);
  EXPECT_GT(with_bad.iterations, 0);
  for (const PoseEstimate* estimate : {&with_good, &with_bad}) {
    EXPECT_EQ(estimate->inlier, without.inlier);
    EXPECT_LT(rotation_error(estimate->rig_from_world, without.rig_from_world), 1e-5);
    EXPECT_LT(position_error(estimate->rig_from_world, without.rig_from_world), 1e-4);
  }
}

TEST(AbsolutePose, SameSeedSameBits) {
  Rng rng(5);
  const PoseScene scene = make_pose_scene(three_cameras(), 200, 0.5, 0.5, rng);
  PoseEstimator one, two;
  PoseEstimate a, b;
  one.estimate(scene.rig, scene.observations(), nullptr, {}, &a);
  two.estimate(scene.rig, scene.observations(), nullptr, {}, &b);
  two.estimate(scene.rig, scene.observations(), nullptr, {}, &b);  // used buffers must not matter
  EXPECT_EQ(a.rig_from_world.rotation.coeffs(), b.rig_from_world.rotation.coeffs());
  EXPECT_EQ(a.rig_from_world.translation, b.rig_from_world.translation);
  EXPECT_EQ(a.covariance, b.covariance);
}

TEST(AbsolutePose, AgreesWithOpenCv) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    Rng rng(seed, 6);
    const PoseScene scene = make_pose_scene(mono(), 80, 0.7, 0, rng);
    PoseOptions options;
    options.loss = {};
    options.max_error_px = 10;  // keeps all
    PoseEstimator estimator;
    PoseEstimate estimate;
    estimator.estimate(scene.rig, scene.observations(), nullptr, options, &estimate);
    ASSERT_TRUE(estimate.ok());
    std::vector<cv::Point3d> points;
    std::vector<cv::Point2d> pixels;
    for (size_t i = 0; i < scene.points.size(); ++i) {
      points.emplace_back(scene.points[i].x(), scene.points[i].y(), scene.points[i].z());
      pixels.emplace_back(scene.pixels[i].x(), scene.pixels[i].y());
    }
    const cv::Matx33d k(500, 0, 320, 0, 510, 240, 0, 0, 1);
    cv::Vec3d rotation, translation;
    ASSERT_TRUE(cv::solvePnP(points, pixels, k, cv::noArray(), rotation, translation));
    cv::solvePnPRefineLM(points, pixels, k, cv::noArray(), rotation, translation);
    const Rigid3 oracle{exp_so3({rotation[0], rotation[1], rotation[2]}),
                        {translation[0], translation[1], translation[2]}};
    EXPECT_LT(rotation_error(estimate.rig_from_world, oracle), 1e-5);
    EXPECT_LT(position_error(estimate.rig_from_world, oracle), 1e-4);
  }
}

// With one standard deviation for all, any unit of it gives the same pose: powers of two even the same bits.
TEST(AbsolutePose, StandardDeviationsAreTheUnitOfResiduals) {
  for (const bool rays : {false, true}) {
    Rng rng(13);
    PoseScene scene = make_pose_scene(three_cameras(), 300, 0.5, 0.4, rng);
    if (rays) scene.keep_rays_alone();
    PoseEstimator estimator;
    PoseEstimate plain, ones, fours;
    const PoseOptions options{.max_error_px = 2, .loss = {RobustLoss::Kind::kHuber, 1}};
    estimator.estimate(scene.rig, scene.observations(), nullptr, options, &plain);
    ASSERT_TRUE(plain.ok());
    scene.sigmas.assign(300, 1);
    estimator.estimate(scene.rig, scene.observations(), nullptr, options, &ones);
    scene.sigmas.assign(300, 4);
    PoseOptions in_sigmas = options;
    in_sigmas.max_error_px = 0.5, in_sigmas.loss.scale = 0.25;
    estimator.estimate(scene.rig, scene.observations(), nullptr, in_sigmas, &fours);
    for (const PoseEstimate* estimate : {&ones, &fours}) {
      EXPECT_EQ(estimate->iterations, plain.iterations);
      EXPECT_EQ(estimate->inlier, plain.inlier);
      EXPECT_EQ(estimate->rig_from_world.rotation.coeffs(), plain.rig_from_world.rotation.coeffs());
      EXPECT_EQ(estimate->rig_from_world.translation, plain.rig_from_world.translation);
      EXPECT_EQ(estimate->covariance, plain.covariance);
    }
    EXPECT_EQ(ones.sigma_px, plain.sigma_px);
    EXPECT_EQ(4 * fours.sigma_px, plain.sigma_px);
  }
}

TEST(AbsolutePose, WideErrorsAreNoOutliersWhereTheyAreExpected) {
  Rng rng(14);
  PoseScene scene = make_pose_scene(mono(), 300, 0.5, 0.3, rng);
  for (int i = 0; i < 300; ++i) scene.sigmas.push_back(i < 200 ? 0.5f : 5.0f);
  for (int i = 200; i < 300; ++i) scene.pixels[i] += 5 * Vector2d(rng.normal(), rng.normal());
  PoseEstimator estimator;
  PoseEstimate estimate;
  estimator.estimate(scene.rig, scene.observations(), nullptr, {.max_error_px = 4}, &estimate);
  ASSERT_TRUE(estimate.ok());
  EXPECT_NEAR(estimate.inlier_count, 210, 4);  // 4 standard deviations hold all but 3 in 10000
  EXPECT_NEAR(estimate.sigma_px, 1, 0.1);
}

// Part of the trials whose true position lies inside the 90 % ellipsoid, and whose true pose lies inside the
// 90 % ellipsoid of six dimensions (chi-square 10.645). `mixed`: near points, which tell the position best,
// are ten times as uncertain as far ones.
std::pair<double, double> covered(const Rig& rig, const RobustLoss& loss, bool rays, bool mixed = false) {
  const int trials = mixed ? 4000 : 2000, points = mixed ? 300 : 150;
  constexpr double kNoise = 0.8, kEllipsoid90Of6 = 10.645;
  Rng rng(7);
  PoseScene scene = make_pose_scene(rig, points, 0, 0, rng);
  const std::vector<Vector2d> exact = scene.pixels;
  for (int i = 0; mixed && i < points; ++i) {
    const bool near = (scene.rig_from_world * scene.points[i]).norm() < 8;
    scene.sigmas.push_back(near ? 2.0f : 0.2f);
  }
  const std::vector<Vector3d> offsets = rays ? make_non_central(&scene, rng) : std::vector<Vector3d>();
  PoseOptions options;
  options.loss = loss;
  options.max_error_px = 100;
  PoseEstimator estimator;
  PoseEstimate estimate;
  int inside = 0, inside6 = 0;
  for (int trial = 0; trial < trials; ++trial) {
    for (int i = 0; i < points; ++i) {
      const double noise = kNoise * scene.observations().sigma(i);
      scene.pixels[i] = exact[i] + noise * Vector2d(rng.normal(), rng.normal());
    }
    if (rays) scene.keep_rays_alone(offsets);
    estimator.estimate(scene.rig, scene.observations(), &scene.rig_from_world, options, &estimate);
    EXPECT_TRUE(estimate.ok());
    const Matrix6d world = covariance_in_world(estimate.rig_from_world, estimate.covariance);
    const Vector3d error =
        scene.rig_from_world.inverse().translation - estimate.rig_from_world.inverse().translation;
    inside += error.dot(world.topLeftCorner<3, 3>().inverse() * error) <= kEllipsoid90;
    const Rigid3 difference = scene.rig_from_world * estimate.rig_from_world.inverse();
    Vector6d tangent;
    tangent.tail<3>() = log_so3(difference.rotation);
    tangent.head<3>() = difference.translation;
    inside6 += tangent.dot(estimate.covariance.inverse() * tangent) <= kEllipsoid90Of6;
  }
  return {double(inside) / trials, double(inside6) / trials};
}

TEST(AbsolutePose, CovarianceCoversTheTruthInNinetyPercent) {
  for (const Rig& rig : {mono(), three_cameras()}) {
    for (const RobustLoss& loss :
         {RobustLoss{}, RobustLoss{RobustLoss::Kind::kHuber, 1.0}, RobustLoss{RobustLoss::Kind::kCauchy, 2.0},
          RobustLoss{RobustLoss::Kind::kTukey, 4.0}}) {
      const auto [position, pose] = covered(rig, loss, false);
      EXPECT_NEAR(position, 0.9, 0.02) << static_cast<int>(loss.kind);
      EXPECT_NEAR(pose, 0.9, 0.02) << static_cast<int>(loss.kind);
    }
  }
}

TEST(AbsolutePose, CovarianceFromRaysCoversTheTruthInNinetyPercent) {
  for (const RobustLoss& loss : {RobustLoss{}, RobustLoss{RobustLoss::Kind::kHuber, 1.0}}) {
    const auto [position, pose] = covered(three_cameras(), loss, true);
    EXPECT_NEAR(position, 0.9, 0.02);
    EXPECT_NEAR(pose, 0.9, 0.02);
  }
}

TEST(AbsolutePose, CovarianceHoldsWithMixedStandardDeviations) {
  for (const RobustLoss& loss : {RobustLoss{}, RobustLoss{RobustLoss::Kind::kHuber, 1.0}}) {
    for (const bool rays : {false, true}) {
      const auto [position, pose] = covered(three_cameras(), loss, rays, true);
      EXPECT_NEAR(position, 0.9, 0.02) << rays;
      EXPECT_NEAR(pose, 0.9, 0.02) << rays;
    }
  }
}

TEST(AbsolutePose, SaysWhyItFails) {
  Rng rng(8);
  PoseEstimator estimator;
  PoseEstimate estimate;
  PoseScene scene = make_pose_scene(mono(), 11, 0, 0, rng);
  estimator.estimate(scene.rig, scene.observations(), nullptr, {}, &estimate);
  EXPECT_EQ(estimate.problem, PoseProblem::kTooFewObservations);
  estimator.estimate(scene.rig, {}, nullptr, {}, &estimate);
  EXPECT_EQ(estimate.problem, PoseProblem::kTooFewObservations);

  scene = make_pose_scene(mono(), 100, 0, 1.0, rng);
  estimator.estimate(scene.rig, scene.observations(), nullptr, {}, &estimate);
  EXPECT_EQ(estimate.problem, PoseProblem::kTooFewInliers);

  // All points on one line: the pose may turn about it.
  scene = make_pose_scene(mono(), 50, 0, 0, rng);
  const Rigid3 world_from_rig = scene.rig_from_world.inverse();
  for (int i = 0; i < 50; ++i) {
    const Vector3d x(-2 + 0.08 * i, 0.5, 6 + 0.03 * i);
    scene.points[i] = world_from_rig * x;
    ASSERT_TRUE(scene.rig.cameras[0].project(x, &scene.pixels[i]));
  }
  estimator.estimate(scene.rig, scene.observations(), nullptr, {}, &estimate);
  EXPECT_FALSE(estimate.ok());
  estimator.estimate(scene.rig, scene.observations(), &scene.rig_from_world, {}, &estimate);
  EXPECT_EQ(estimate.problem, PoseProblem::kDegenerate);
}

TEST(AbsolutePose, NotANumberIsAnOutlier) {
  Rng rng(9);
  PoseScene scene = make_pose_scene(mono(), 100, 0.3, 0, rng);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 20; ++i) scene.points[i].y() = nan;
  for (int i = 20; i < 40; ++i) scene.pixels[i].x() = nan;
  PoseEstimator estimator;
  PoseEstimate estimate;
  estimator.estimate(scene.rig, scene.observations(), nullptr, {}, &estimate);
  ASSERT_TRUE(estimate.ok());
  EXPECT_EQ(estimate.inlier_count, 60);
  EXPECT_LT(position_error(estimate.rig_from_world, scene.rig_from_world), 0.03);
  scene.keep_rays_alone();
  estimator.estimate({}, scene.observations(), nullptr, {}, &estimate);
  ASSERT_TRUE(estimate.ok());
  EXPECT_EQ(estimate.inlier_count, 60);
}

}  // namespace
}  // namespace raysfm
