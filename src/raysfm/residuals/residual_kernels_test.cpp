#include "raysfm/residuals/residual_kernels.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <cstring>
#include <vector>

#include "raysfm/bundle/residual.h"
#include "support/bundle_scene.h"
#include "support/instruction_sets.h"

namespace raysfm {
namespace {

// The errors once more, from their formulas, for Ceres's automatic differentiation.

template <typename T>
using Vec3 = Eigen::Matrix<T, 3, 1>;
template <typename T>
using Vec2 = Eigen::Matrix<T, 2, 1>;

template <typename T>
Vec2<T> pinhole(const PinholeInRig& c, const Vec3<T>& x) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> r(c.rotation);
  const Vec3<T> p = r.cast<T>() * x + Eigen::Map<const Eigen::Vector3d>(c.translation).cast<T>();
  return {c.fx * p.x() / p.z() + c.cx, c.fy * p.y() / p.z() + c.cy};
}

// Brown's model as models/radtan.h writes it.
template <typename T>
Vec2<T> radtan(const RadtanInRig& c, const Vec3<T>& point) {
  PinholeInRig normalised = c.pinhole;
  normalised.fx = normalised.fy = 1, normalised.cx = normalised.cy = 0;
  const Vec2<T> n = pinhole(normalised, point);
  const T x = n.x(), y = n.y(), r2 = x * x + y * y;
  const T s = 1.0 + c.k1 * r2 + c.k2 * r2 * r2 + c.k3 * r2 * r2 * r2;
  return {c.pinhole.fx * (s * x + 2 * c.p1 * x * y + c.p2 * (r2 + 2.0 * x * x)) + c.pinhole.cx,
          c.pinhole.fy * (s * y + c.p1 * (r2 + 2.0 * y * y) + 2 * c.p2 * x * y) + c.pinhole.cy};
}

// LBA09 3.2 to the letter: R takes the direction to the z axis, and r = (x / z, y / z) of R (X - s); whitened
// by the 2x2 matrix `w`.
template <typename T>
Vec2<T> angular(const Ray& ray, const Eigen::Matrix2d& w, const Vec3<T>& x) {
  const Vec3<T> d = rotation_to_z(ray.direction).cast<T>() * (x - ray.origin.cast<T>());
  return w.cast<T>() * Vec2<T>(d.x() / d.z(), d.y() / d.z());
}

template <typename T>
Vec2<T> lens(const Vec3<T>& l, const Vec3<T>& x) {
  const Vec2<T> p = -x.template head<2>() / x.z();
  const T s = p.squaredNorm();
  return l[0] * (T(1) + l[1] * s + l[2] * s * s) * p;
}

using Jet = ceres::Jet<double, 6>;

Vec3<Jet> variables(const Eigen::Vector3d& x, int first) {
  return {Jet(x[0], first), Jet(x[1], first + 1), Jet(x[2], first + 2)};
}

void expect_lane(const ResidualBlock& block, int k, const Vec2<Jet>& r, const Eigen::Vector2d& observed) {
  for (int row = 0; row < 2; ++row) {
    EXPECT_NEAR(block.residual[row][k], r[row].a - observed[row], 1e-10);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(block.jacobian[3 * row + c][k], r[row].v[c], 1e-9);
  }
  const Eigen::Vector2d residual(r[0].a - observed[0], r[1].a - observed[1]);
  EXPECT_NEAR(block.squared[k], residual.squaredNorm(), 1e-9 * (1 + residual.squaredNorm()));
}

struct Fixture {
  std::vector<Eigen::Vector3d> x;
  double u[kBlockLanes], v[kBlockLanes];
  ObservationBlock<9> block{};
  RayBlock rays{};
  std::vector<Ray> ray;
  std::vector<Eigen::Matrix2d> whitening;

  // Points at z in [low, high].
  Fixture(double low, double high) {
    Rng rng(4);
    for (int k = 0; k < kBlockLanes; ++k) {
      x.emplace_back(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(low, high));
      u[k] = rng.uniform(0, 600), v[k] = rng.uniform(0, 400);
      for (int c = 0; c < 3; ++c) block.x[c][k] = x[k][c];
      const Eigen::Vector3d origin = test::random_vector(rng, 0.2);
      ray.push_back({origin, (x[k] - origin + test::random_vector(rng, 0.3)).normalized()});
      whitening.push_back(500 * Eigen::Matrix2d{{1 + rng.uniform(), 0.1 * rng.normal()}, {0.1, 1}});
      const Eigen::Matrix<double, 2, 3> tangents =
          whitening[k] * rotation_to_z(ray[k].direction).topRows<2>();
      for (int c = 0; c < 3; ++c) rays.origin[c][k] = origin[c], rays.direction[c][k] = ray[k].direction[c];
      for (int c = 0; c < 6; ++c) rays.tangents[c][k] = tangents(c / 3, c % 3);
    }
  }
};

PinholeInRig pinhole_in_rig() {
  PinholeInRig camera{500, 510, 320, 240, {}, {0.1, -0.2, 0.3}};
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> r = exp_so3({0.1, -0.2, 0.3}).toRotationMatrix();
  std::copy_n(r.data(), 9, camera.rotation);
  return camera;
}

TEST(ResidualKernels, PinholeIsItsAutomaticDerivative) {
  Fixture f(2, 9);
  const PinholeInRig camera = pinhole_in_rig();
  pinhole_residuals(camera, f.u, f.v, &f.block);
  for (int k = 0; k < kBlockLanes; ++k) {
    expect_lane(f.block, k, pinhole(camera, variables(f.x[k], 0)), {f.u[k], f.v[k]});
  }
}

RadtanInRig radtan_in_rig() {
  return {pinhole_in_rig(), -0.28, 0.07, 0.02, 1e-3, -2e-3, 4};
}

TEST(ResidualKernels, RadtanIsItsAutomaticDerivative) {
  Fixture f(2, 9);
  const RadtanInRig camera = radtan_in_rig();
  radtan_residuals(camera, f.u, f.v, &f.block);
  for (int k = 0; k < kBlockLanes; ++k) {
    expect_lane(f.block, k, radtan(camera, variables(f.x[k], 0)), {f.u[k], f.v[k]});
  }
}

TEST(ResidualKernels, RadtanEndsWhereItFoldsBack) {
  Fixture f(2, 9);
  RadtanInRig camera = radtan_in_rig();
  camera.max_radius2 = 0.05;
  radtan_residuals(camera, f.u, f.v, &f.block);
  int outside = 0;
  for (int k = 0; k < kBlockLanes; ++k) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> r(camera.pinhole.rotation);
    const Eigen::Vector3d x = r * f.x[k] + Eigen::Map<const Eigen::Vector3d>(camera.pinhole.translation);
    const bool inside = x.z() > 0 && (x.head<2>() / x.z()).squaredNorm() < camera.max_radius2;
    outside += !inside;
    EXPECT_EQ(std::isfinite(f.block.squared[k]), inside);
  }
  EXPECT_GT(outside, 0);
  EXPECT_LT(outside, kBlockLanes);
}

TEST(ResidualKernels, AngularIsItsAutomaticDerivative) {
  for (const bool whitened : {false, true}) {
    Fixture f(2, 9);
    for (int k = 0; k < kBlockLanes; ++k) {
      if (whitened) continue;
      f.whitening[k].setIdentity();
      const Eigen::Matrix3d r = rotation_to_z(f.ray[k].direction);
      for (int c = 0; c < 6; ++c) f.rays.tangents[c][k] = r(c / 3, c % 3);
    }
    angular_residuals(f.rays, &f.block);
    for (int k = 0; k < kBlockLanes; ++k) {
      expect_lane(f.block, k, angular(f.ray[k], f.whitening[k], variables(f.x[k], 0)), {0, 0});
    }
  }
}

TEST(ResidualKernels, LensIsItsAutomaticDerivative) {
  Fixture f(-9, -2);
  const BalLens l{500, -0.2, 0.05};
  lens_residuals(l, f.u, f.v, &f.block);
  for (int k = 0; k < kBlockLanes; ++k) {
    const Vec2<Jet> r = lens(variables({l.f, l.k1, l.k2}, 3), variables(f.x[k], 0));
    expect_lane(f.block, k, r, {f.u[k], f.v[k]});
    for (int c = 0; c < 6; ++c) EXPECT_NEAR(f.block.lens[c][k], r[c / 3].v[3 + c % 3], 1e-9);
    Eigen::Vector2d alone;
    ASSERT_TRUE(lens_residual(l, f.x[k], {f.u[k], f.v[k]}, &alone));
    EXPECT_NEAR(alone[0], f.block.residual[0][k], 1e-10);
  }
}

TEST(ResidualKernels, BehindHasNoResidual) {
  Fixture behind(-9, -2), front(2, 9);
  PinholeInRig camera = pinhole_in_rig();
  std::fill_n(camera.translation, 3, 0.0);
  pinhole_residuals(camera, behind.u, behind.v, &behind.block);
  lens_residuals({500, 0, 0}, front.u, front.v, &front.block);
  for (int k = 0; k < kBlockLanes; ++k) {
    EXPECT_EQ(behind.block.squared[k], HUGE_VAL);
    EXPECT_EQ(front.block.squared[k], HUGE_VAL);
  }
  for (auto& row : front.rays.direction) {
    for (double& d : row) d = -d;
  }
  angular_residuals(front.rays, &front.block);
  for (int k = 0; k < kBlockLanes; ++k) EXPECT_EQ(front.block.squared[k], HUGE_VAL);
}

TEST(ResidualKernels, InstructionSetsChangeNoBit) {
  std::vector<Fixture> results;
  testing_support::for_each_instruction_set([&](const char*) {
    Fixture pixel(2, 9), distorted(2, 9), angle(2, 9), bal(-9, -2);
    pinhole_residuals(pinhole_in_rig(), pixel.u, pixel.v, &pixel.block);
    radtan_residuals(radtan_in_rig(), distorted.u, distorted.v, &distorted.block);
    angular_residuals(angle.rays, &angle.block);
    lens_residuals({500, -0.2, 0.05}, bal.u, bal.v, &bal.block);
    for (const Fixture& f : {pixel, distorted, angle, bal}) results.push_back(f);
  });
  for (size_t i = 0; i < results.size(); ++i) {
    EXPECT_EQ(std::memcmp(&results[i].block, &results[i % 4].block, sizeof(results[i].block)), 0);
  }
}

}  // namespace
}  // namespace raysfm
