#include "raysfm/bundle/covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "raysfm/bundle/bundle_adjuster.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

using test::BundleScene;
using test::make_bundle_scene;

// The whole inverse from numeric derivatives of the residuals, by tangents of the free poses and points.
struct DenseCovariance {
  Eigen::MatrixXd jacobian, pseudo_inverse;
  int rank = 0;

  explicit DenseCovariance(const BundleScene& scene) {
    BundleScene s = scene;
    const int poses = static_cast<int>(s.poses.size()), points = static_cast<int>(s.points.size());
    jacobian.resize(2 * s.observations.size(), 6 * poses + 3 * points);
    const auto residuals = [&] {
      Eigen::VectorXd r(jacobian.rows());
      for (size_t i = 0; i < s.observations.size(); ++i) {
        Eigen::Vector2d one;
        EXPECT_TRUE(residual_of(s.problem(), static_cast<int>(i), &one));
        r.segment<2>(2 * i) = one;
      }
      return r;
    };
    constexpr double h = 1e-5;
    for (int c = 0; c < jacobian.cols(); ++c) {
      Eigen::VectorXd r[2];
      for (const int side : {0, 1}) {
        s = scene;
        const double step = side == 0 ? -h : h;
        if (c >= 6 * poses) {
          s.points[(c - 6 * poses) / 3][(c - 6 * poses) % 3] += step;
        } else if (s.pose_is_free[c / 6]) {
          s.poses[c / 6] = retract(s.poses[c / 6], step * Eigen::Matrix<double, 6, 1>::Unit(c % 6));
        }
        r[side] = residuals();
      }
      jacobian.col(c) = (r[1] - r[0]) / (2 * h);
    }
    Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(jacobian.transpose() * jacobian);
    Eigen::VectorXd inverse = eigen.eigenvalues();
    for (double& x : inverse) {
      const bool is_zero = x < 1e-9 * eigen.eigenvalues().maxCoeff();
      rank += !is_zero;
      x = is_zero ? 0 : 1 / x;
    }
    pseudo_inverse = eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose();
  }
};

void expect_dense(const BundleScene& scene, int gauge_freedoms) {
  BundleScene s = scene;
  const Result<BundleCovariance> found = bundle_covariance(s.problem(), {}, 2.0);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_EQ(found->gauge_freedoms, gauge_freedoms);
  EXPECT_EQ(found->sigma2, 4.0);
  const DenseCovariance dense(scene);
  const int poses = static_cast<int>(scene.poses.size());
  for (int i = 0; i < poses; ++i) {
    const Eigen::MatrixXd expected = 4 * dense.pseudo_inverse.block(6 * i, 6 * i, 6, 6);
    EXPECT_LE((found->poses[i] - expected).norm(), 1e-4 * expected.norm()) << i;
  }
  for (size_t p = 0; p < scene.points.size(); ++p) {
    const Eigen::Index k = 6 * poses + 3 * static_cast<Eigen::Index>(p);
    const Eigen::MatrixXd expected = 4 * dense.pseudo_inverse.block(k, k, 3, 3);
    EXPECT_LE((found->points[p] - expected).norm(), 1e-4 * expected.norm()) << p;
  }
}

TEST(Covariance, IsTheDenseInverse) {
  expect_dense(
      make_bundle_scene({.poses = 6, .free_poses = 3, .points = 30, .pose_error = 0, .point_error = 0}), 0);
}

TEST(Covariance, NothingFixedIsTheDensePseudoInverse) {
  expect_dense(
      make_bundle_scene({.poses = 5, .free_poses = 5, .points = 30, .pose_error = 0, .point_error = 0}), 7);
}

TEST(Covariance, OnePoseFixedLeavesTheScale) {
  expect_dense(
      make_bundle_scene({.poses = 5, .free_poses = 4, .points = 30, .pose_error = 0, .point_error = 0}), 1);
}

TEST(Covariance, ARigHoldsTheScale) {
  Camera left = test::pinhole_camera(), right = left;
  right.rig_from_cam.translation.x() = 0.5;
  expect_dense(make_bundle_scene({.poses = 4,
                                  .free_poses = 4,
                                  .points = 25,
                                  .track = 4,
                                  .pose_error = 0,
                                  .point_error = 0,
                                  .cameras = {left, right}}),
               6);
}

// 90 % of the ellipsoids hold the truth: 10.645 and 6.251 are the 90 % points of chi squared with 6 and 3
// degrees of freedom. The camera knows nothing of the truth but the pixels. `mixed`: three in four pixels of
// the last two poses are sixteen times as uncertain as the rest, and known to be.
void expect_ninety_percent(int free_poses, int trials, bool mixed = false) {
  const int poses = 5;
  BundleScene scene = make_bundle_scene({.poses = poses,
                                         .free_poses = free_poses,
                                         .points = 25,
                                         .track = 5,
                                         .noise_px = 0,
                                         .pose_error = 0,
                                         .point_error = 0});
  for (size_t i = 0; mixed && i < scene.observations.size(); ++i) {
    const BundleObservation& o = scene.observations[i];
    scene.sigmas.push_back(o.pose >= poses - 2 && o.point % 4 > 0 ? 4.0f : 0.25f);
  }
  Rng rng(77);
  BundleAdjuster adjuster;
  int pose_hits = 0, point_hits = 0, pose_trials = 0, point_trials = 0;
  double sigma2 = 0;
  for (int trial = 0; trial < trials; ++trial) {
    BundleScene noisy = scene;
    for (size_t i = 0; i < noisy.observations.size(); ++i) {
      const double noise = 0.5 * (mixed ? scene.sigmas[i] : 1);
      noisy.observations[i].pixel += noise * Eigen::Vector2d(rng.normal(), rng.normal());
    }
    adjuster.adjust(noisy.problem(), {.max_iterations = 20, .min_relative_decrease = 1e-10});
    const Result<BundleCovariance> covariance = bundle_covariance(noisy.problem(), {});
    ASSERT_TRUE(covariance);
    sigma2 += covariance->sigma2 / trials;
    for (int i = poses - free_poses; i < poses; ++i) {
      // Tangent that leads from the estimate to the truth.
      const Rigid3& truth = scene.true_poses[i];
      const Eigen::Quaterniond r = truth.rotation * noisy.poses[i].rotation.conjugate();
      Eigen::Matrix<double, 6, 1> error;
      error << truth.translation - r * noisy.poses[i].translation, log_so3(r);
      pose_hits += error.dot(covariance->poses[i].llt().solve(error)) <= 10.645;
      ++pose_trials;
    }
    for (size_t p = 0; p < scene.points.size(); p += 6) {
      const Eigen::Vector3d error = noisy.points[p] - scene.true_points[p];
      point_hits += error.dot(covariance->points[p].llt().solve(error)) <= 6.251;
      ++point_trials;
    }
  }
  EXPECT_NEAR(sigma2, 0.25, 0.01);
  EXPECT_NEAR(double(pose_hits) / pose_trials, 0.9, 0.02);
  EXPECT_NEAR(double(point_hits) / point_trials, 0.9, 0.02);
}

TEST(Covariance, NinetyPercentOfTheEllipsoidsHoldTheTruth) {
  expect_ninety_percent(3, 2000);
}

TEST(Covariance, NinetyPercentWithMixedStandardDeviations) {
  expect_ninety_percent(3, 2000, true);
}

TEST(Covariance, WhatIsNotDeterminedIsSaid) {
  BundleScene scene = make_bundle_scene({.poses = 6, .free_poses = 3, .points = 40});
  // Point 0 seen once, point 1 never; pose 5 sees nothing.
  std::erase_if(scene.observations, [seen = false](const BundleObservation& o) mutable {
    if (o.pose == 5 || o.point == 1) return true;
    return o.point == 0 && std::exchange(seen, true);
  });
  scene.is_inlier.assign(scene.observations.size(), 1);
  const Result<BundleCovariance> covariance = bundle_covariance(scene.problem(), {}, 1.0);
  ASSERT_TRUE(covariance);
  EXPECT_TRUE(covariance->points[0].array().isNaN().all());
  EXPECT_TRUE(covariance->points[1].array().isNaN().all());
  EXPECT_TRUE(covariance->points[2].allFinite());
  EXPECT_TRUE(covariance->poses[5].array().isNaN().all());
  EXPECT_TRUE(covariance->poses[4].allFinite());
  EXPECT_TRUE(covariance->poses[0].isZero(0));
}

TEST(Covariance, Refuses) {
  BundleScene scene = make_bundle_scene({.poses = 6, .free_poses = 3, .points = 40});
  EXPECT_FALSE(bundle_covariance(scene.problem(), {}, -1.0));
  BundleScene fixed = scene;
  fixed.pose_is_free.assign(6, 0);
  fixed.point_is_fixed.assign(40, 1);
  EXPECT_FALSE(bundle_covariance(fixed.problem(), {}));
  BundleScene bad = scene;
  bad.observations[0].point = 40;
  EXPECT_FALSE(bundle_covariance(bad.problem(), {}));
  // Two points do not hold a pose.
  BundleScene few = scene;
  std::erase_if(few.observations, [](const BundleObservation& o) { return o.pose == 5 && o.point > 39; });
  int left = 0;
  std::erase_if(few.observations, [&](const BundleObservation& o) { return o.pose == 5 && ++left > 2; });
  few.is_inlier.assign(few.observations.size(), 1);
  EXPECT_FALSE(bundle_covariance(few.problem(), {}));
}

}  // namespace
}  // namespace raysfm
