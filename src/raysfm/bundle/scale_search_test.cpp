#include "raysfm/bundle/scale_search.h"

#include <gtest/gtest.h>

#include "raysfm/bundle/scale_estimate.h"
#include "raysfm/camera/pixel_finder.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

// Two cameras 0.5 m apart that see opposite sides share no points, so that only their turning tells the
// scale.
std::vector<Camera> back_to_back(double half_distance) {
  std::vector<Camera> cameras(2, test::pinhole_camera());
  cameras[0].rig_from_cam.translation = {half_distance, 0, 0};
  cameras[1].rig_from_cam = {exp_so3({0, std::numbers::pi, 0}), {-half_distance, 0, 0}};
  return cameras;
}

// The rig turns about all axes as it goes, or not at all; every point is seen by one of the cameras in each
// pose, 5 m away.
test::BundleScene make_scene(const std::vector<Camera>& cameras, double turn, double noise_px, int poses = 8,
                             int points = 160) {
  Rng rng(4);
  test::BundleScene scene;
  scene.cameras = cameras;
  for (int i = 0; i < poses; ++i) {
    const Rigid3 world_from_rig{exp_so3(turn * i * Eigen::Vector3d(0.03, 0.05, -0.04)),
                                Eigen::Vector3d(0.15 * i, 0.02 * i, 0.05 * i)};
    scene.true_poses.push_back(world_from_rig.inverse());
    scene.pose_is_free.push_back(i > 0);
  }
  for (int p = 0; p < points; ++p) {
    const int camera = p % 2;
    const Eigen::Vector3d in_cam(rng.uniform(-1.2, 1.2), rng.uniform(-0.9, 0.9), rng.uniform(4, 6));
    scene.true_points.push_back(cameras[camera].rig_from_cam * in_cam);
    for (int i = 0; i < poses; ++i) {
      Eigen::Vector2d pixel;
      if (!cameras[camera].project(
              cameras[camera].rig_from_cam.inverse() * (scene.true_poses[i] * scene.true_points[p]),
              &pixel)) {
        continue;
      }
      pixel += noise_px * Eigen::Vector2d(rng.normal(), rng.normal());
      scene.observations.push_back({i, p, camera, pixel});
    }
  }
  scene.is_inlier.assign(scene.observations.size(), 1);
  return scene;
}

// Poses and points at a multiple of their true scale about the first rig, and the prior that says so.
BundleProblem scaled(test::BundleScene& scene, double scale) {
  scene.poses = scene.true_poses;
  scene.points = scene.true_points;
  for (Rigid3& pose : scene.poses) pose.translation *= scale;
  for (Eigen::Vector3d& point : scene.points) point *= scale;
  BundleProblem problem = scene.problem();
  const int last = static_cast<int>(scene.poses.size()) - 1;
  problem.scale_prior = {last, 0, scene.poses[last].inverse().translation.norm(), 0};
  return problem;
}

TEST(ScaleSearch, FindsTheScaleThatATurningRigTells) {
  test::BundleScene scene = make_scene(back_to_back(0.25), 1, 0.3);
  const double truth = scene.true_poses.back().inverse().translation.norm();
  for (const double start : {1.0, 3.0, 0.4}) {
    BundleAdjuster adjuster;
    BundleProblem problem = scaled(scene, start);
    const ScaleSearch found = search_scale(adjuster, problem, {.max_iterations = 40});
    EXPECT_NEAR(found.distance / truth, 1, 0.05) << "from " << start;
    EXPECT_LT(found.sigma, 0.05) << "from " << start;
    EXPECT_NEAR(problem.rig_from_world.back().inverse().translation.norm(), found.distance, 1e-3 * truth);
  }
}

// Scale of a trajectory as a similarity fits it to the truth.
double scale_of(const test::BundleScene& scene) {
  const int count = static_cast<int>(scene.poses.size());
  Eigen::Vector3d mean = Eigen::Vector3d::Zero(), true_mean = mean;
  for (int i = 0; i < count; ++i) {
    mean += scene.poses[i].inverse().translation / count;
    true_mean += scene.true_poses[i].inverse().translation / count;
  }
  double product = 0, square = 0;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d truth = scene.true_poses[i].inverse().translation - true_mean;
    product += truth.dot(scene.poses[i].inverse().translation - mean);
    square += truth.squaredNorm();
  }
  return product / square;
}

// Mean square of the error of the scale in standard deviations: 1 with a standard deviation of 0.14. `spoil`
// adds to the pixels of an exact scene.
template <typename Spoil>
double mean_square_error(Spoil spoil) {
  constexpr int kTrials = 100;
  const test::BundleScene exact = make_scene(back_to_back(0.25), 1, 0);
  Rng rng(9);
  double sum = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    test::BundleScene scene = exact;
    spoil(rng, &scene);
    BundleAdjuster adjuster;
    const ScaleSearch found =
        search_scale(adjuster, scaled(scene, 1), {.max_iterations = 40, .min_relative_decrease = 1e-9});
    sum += std::pow(std::log(scale_of(scene)) / found.sigma, 2) / kTrials;
  }
  return sum;
}

// A camera before a sphere mirror goes through a room; exact pixels.
test::BundleScene mirror_scene() {
  constexpr int kPoses = 12, kPoints = 400;
  Rng rng(5);
  test::BundleScene scene;
  Camera& camera = scene.cameras.emplace_back();
  camera.model = Mirror::from_parameters(
      {1640, 1640, 319.5, 319.5, 0.1, 0, 0.083, 0.0025, -0.0015, 0.4, 0, 0, 0, 1, 0.022});
  camera.width = camera.height = 640;
  const PixelFinder finder(camera);
  for (int i = 0; i < kPoses; ++i) {
    const Rigid3 world_from_rig{exp_so3(i * Eigen::Vector3d(0.05, -0.08, 0.06)),
                                Eigen::Vector3d(0.2 * i, 0.1 * std::sin(i), 0.05 * i)};
    scene.true_poses.push_back(world_from_rig.inverse());
    scene.pose_is_free.push_back(i > 0);
  }
  for (int p = 0; p < kPoints; ++p) {
    scene.true_points.push_back({rng.uniform(-3, 4), rng.uniform(-3, 3), rng.uniform(-3, 3)});
    for (int i = 0; i < kPoses; ++i) {
      const Eigen::Vector3d in_cam = scene.true_poses[i] * scene.true_points[p];
      Eigen::Vector2d pixel;
      if (in_cam.norm() < 1 || !finder.find(in_cam, &pixel)) continue;
      const double radius = (pixel - Eigen::Vector2d(319.5, 319.5)).norm();  // well inside what it sees
      if (radius > 90 && radius < 290) scene.observations.push_back({i, p, 0, pixel});
    }
  }
  scene.is_inlier.assign(scene.observations.size(), 1);
  return scene;
}

// The cost of angles must not fall because what is seen moves away: then the scale would come out too large,
// by several standard deviations here.
TEST(ScaleSearch, AMirrorTellsItWithoutBias) {
  constexpr int kTrials = 10;
  const test::BundleScene exact = mirror_scene();
  Rng rng(3);
  BundleAdjuster adjuster;
  double mean = 0, variance = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    test::BundleScene scene = exact;
    for (BundleObservation& o : scene.observations)
      o.pixel += 0.4 * Eigen::Vector2d(rng.normal(), rng.normal());
    test::observe_rays(&scene, AngularWeight::kPixel);
    const ScaleSearch found =
        search_scale(adjuster, scaled(scene, 1), {.max_iterations = 40, .min_relative_decrease = 1e-9});
    mean += std::log(scale_of(scene)) / kTrials;
    variance += found.sigma * found.sigma / kTrials / kTrials;
  }
  EXPECT_LT(variance, 0.05 * 0.05);
  EXPECT_NEAR(mean, 0, 2.5 * std::sqrt(variance));
}

TEST(ScaleSearch, ErrorsAreAsLargeAsStated) {
  const double square = mean_square_error([](Rng& rng, test::BundleScene* scene) {
    for (BundleObservation& o : scene->observations) {
      o.pixel += 0.3 * Eigen::Vector2d(rng.normal(), rng.normal());
    }
  });
  EXPECT_GT(square, 0.55);
  EXPECT_LT(square, 1.4);
}

// A patch that drifts from view to view is wrong in all of them together.
TEST(ScaleSearch, ErrorsThatGoTogetherInAPointCountAsMuch) {
  const double square = mean_square_error([](Rng& rng, test::BundleScene* scene) {
    std::vector<Eigen::Vector2d> drift;
    for (size_t p = 0; p < scene->points.size() || p < scene->true_points.size(); ++p) {
      drift.push_back(0.1 * Eigen::Vector2d(rng.normal(), rng.normal()));
    }
    for (BundleObservation& o : scene->observations) o.pixel += o.pose * drift[o.point];
  });
  EXPECT_GT(square, 0.55);
  EXPECT_LT(square, 1.6);
}

TEST(ScaleSearch, SaysSoWhereNothingTellsIt) {
  // No turn, so that each camera sees the same translation; or one centre.
  for (const auto& [half_distance, turn] : {std::pair(0.25, 0.0), std::pair(0.0, 1.0)}) {
    test::BundleScene scene = make_scene(back_to_back(half_distance), turn, 0.3);
    BundleAdjuster adjuster;
    const ScaleSearch found = search_scale(adjuster, scaled(scene, 1), {.max_iterations = 40});
    EXPECT_GT(found.sigma, 1.0 / 6) << half_distance << " " << turn;
  }
}

// Errors of rotations that are next to none look like turns, which a long path has many of.
TEST(ScaleSearch, APathWithoutATurnStaysAtItsScale) {
  for (const int poses : {20, 40, 60}) {
    for (const int points : {600, 2000}) {
      test::BundleScene scene = make_scene(back_to_back(0.25), 0, 0.3, poses, points);
      const BundleProblem problem = scaled(scene, 1);
      const Eigen::Vector3d last = problem.rig_from_world.back().inverse().translation;
      BundleAdjuster adjuster;
      const ScaleSearch found = search_scale(adjuster, problem, {.max_iterations = 5});
      EXPECT_NEAR(found.distance / problem.scale_prior.distance, 1, 0.5) << poses << " " << points;
      EXPECT_GT(found.sigma, 1.0 / 6) << poses << " " << points;
      EXPECT_LT((scene.poses.back().inverse().translation - last).norm(), 0.05) << poses << " " << points;
    }
  }
}

// A long path with next to no turn. The patch of each point drifts by so much from pose to pose.
test::BundleScene drifting_scene(double drift_px, uint64_t seed) {
  constexpr int kPoses = 40;
  test::BundleScene scene = make_scene(back_to_back(0.25), 0.02, 0, kPoses, 600);
  Rng rng(seed);
  std::vector<Eigen::Vector2d> drift;
  for (size_t p = 0; p < scene.true_points.size(); ++p)
    drift.push_back(drift_px * Eigen::Vector2d(rng.normal(), rng.normal()));
  for (BundleObservation& o : scene.observations)
    o.pixel += (o.pose - kPoses / 2) * drift[o.point] + 0.2 * Eigen::Vector2d(rng.normal(), rng.normal());
  return scene;
}

TEST(ScaleSearch, AScaleFarOffIsNotBelievedForErrorsThatGoTogether) {
  const auto alike_in = [](test::BundleScene scene) {
    const BundleProblem problem = scaled(scene, 1);
    BundleAdjuster adjuster;
    adjuster.adjust(problem, {.max_iterations = 20});
    const std::optional<ScaleEstimate> found = estimate_scale(problem, {});
    return found ? found->alike : 0;
  };
  EXPECT_LT(alike_in(drifting_scene(0, 1)), 1.3);
  EXPECT_GT(alike_in(drifting_scene(0.05, 1)), 8);
  // Half the true scale, of which the odds are those of hundreds of independent errors.
  test::BundleScene scene = drifting_scene(0.05, 1);
  const BundleProblem problem = scaled(scene, 4);
  BundleAdjuster adjuster;
  const ScaleSearch found = search_scale(adjuster, problem, {.max_iterations = 20});
  EXPECT_EQ(found.distance, problem.scale_prior.distance);
  EXPECT_EQ(found.sigma, INFINITY);
}

// The prior alone decides where the observations say nothing, and nothing where they do.
TEST(ScalePrior, HoldsTheScaleOfACentralRigAndYieldsToEvidence) {
  for (const auto& [half_distance, weight, expected] :
       {std::tuple(0.0, 1e-3, 2.0), std::tuple(0.25, 1e-3, 1.0), std::tuple(0.25, 1e9, 2.0)}) {
    test::BundleScene scene = make_scene(back_to_back(half_distance), 1, 0.1);
    const double truth = scene.true_poses.back().inverse().translation.norm();
    BundleProblem problem = scaled(scene, 1);
    problem.scale_prior.distance = 2 * truth;
    problem.scale_prior.weight = weight;
    BundleAdjuster adjuster;
    adjuster.adjust(problem, {.max_iterations = 200, .min_relative_decrease = 1e-14});
    EXPECT_NEAR(problem.rig_from_world.back().inverse().translation.norm() / truth, expected, 0.05)
        << half_distance << " " << weight;
  }
}

}  // namespace
}  // namespace raysfm
