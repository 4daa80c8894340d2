#include "raysfm/optim/schur_system.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>

#include "raysfm/core/random.h"
#include "support/instruction_sets.h"

namespace raysfm {
namespace {

// Random Jacobians of a bundle: two residuals for each slot, of one pose and one point. The dense normal
// equations are formed from the whole Jacobian, the blocks from the rows of each slot.
template <int N>
struct RandomBundle {
  int poses, points;
  std::vector<int> point_begin{0}, pose_of_slot;
  Eigen::MatrixXd h;
  Eigen::VectorXd g;
  SchurSystem<N> system;
  WorkTeam team;

  RandomBundle(int poses, int points, int longest_track, uint64_t seed, int threads = 1, bool dense = true)
      : poses(poses), points(points), team(threads) {
    Rng rng(seed);
    for (int p = 0; p < points; ++p) {
      const int length =
          static_cast<int>(rng.index(longest_track + 1));  // also points that no free pose sees
      const int first = static_cast<int>(rng.index(std::max(1, poses - length)));
      for (int i = first; i < std::min(poses, first + length); ++i) pose_of_slot.push_back(i);
      point_begin.push_back(static_cast<int>(pose_of_slot.size()));
    }
    system.set_structure(poses, point_begin, pose_of_slot);
    system.set_zero();
    fill(rng, dense);
  }

  // The whole Jacobian is only made where `dense`: it is large.
  void fill(Rng& rng, bool dense) {
    const int columns = N * poses + 3 * points;
    const int slots = static_cast<int>(pose_of_slot.size());
    const auto random = [&](int rows, int cols) {
      Eigen::MatrixXd m(rows, cols);
      for (double& x : m.reshaped()) x = rng.normal();
      return m;
    };
    Eigen::MatrixXd j = Eigen::MatrixXd::Zero(dense ? 2 * slots + 3 * points : 0, columns);
    Eigen::VectorXd r(j.rows());
    for (int p = 0; p < points; ++p) {
      const int point_column = N * poses + 3 * p;
      for (int s = point_begin[p]; s < point_begin[p + 1]; ++s) {
        const Eigen::MatrixXd jc = random(2, N), jp = random(2, 3), rs = random(2, 1);
        add_slot(jc, jp, rs, s, p);
        if (!dense) continue;
        j.block(2 * s, N * pose_of_slot[s], 2, N) = jc;
        j.block(2 * s, point_column, 2, 3) = jp;
        r.segment(2 * s, 2) = rs;
      }
      // Three rows of the point alone, as fixed poses give.
      const Eigen::MatrixXd jp = random(3, 3), rp = random(3, 1);
      add_point(jp, rp, p);
      if (!dense) continue;
      j.block(2 * slots + 3 * p, point_column, 3, 3) = jp;
      r.segment(2 * slots + 3 * p, 3) = rp;
    }
    if (!dense) return;
    h = j.transpose() * j;
    g = j.transpose() * r;
  }

  void add_point(const Eigen::MatrixXd& jp, const Eigen::VectorXd& r, int p) {
    const Eigen::Matrix3d v = jp.transpose() * jp;
    const Eigen::Vector3d gp = jp.transpose() * r;
    const double packed[6] = {v(0, 0), v(0, 1), v(0, 2), v(1, 1), v(1, 2), v(2, 2)};
    for (int k = 0; k < 6; ++k) system.point(p).v[k] += packed[k];
    for (int k = 0; k < 3; ++k) system.point(p).gradient[k] += gp[k];
  }

  void add_slot(const Eigen::MatrixXd& jc, const Eigen::MatrixXd& jp, const Eigen::VectorXd& r, int s,
                int p) {
    const int i = pose_of_slot[s];
    add_point(jp, r, p);
    Eigen::Map<Eigen::Matrix<double, N, N>>(system.pose(i).u) += jc.transpose() * jc;
    Eigen::Map<Eigen::Matrix<double, N, 1>>(system.pose(i).gradient) += jc.transpose() * r;
    const Eigen::Matrix<double, N, 3> w = jc.transpose() * jp;
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < N; ++k) system.cross(s)[cross_place<N>(k, c)] += w(k, c);
    }
  }

  Eigen::VectorXd step() const {
    Eigen::VectorXd d(N * poses + 3 * points);
    for (int i = 0; i < poses; ++i)
      d.segment(N * i, N) = Eigen::Map<const Eigen::VectorXd>(system.pose_step(i), N);
    for (int p = 0; p < points; ++p) {
      d.segment(N * poses + 3 * p, 3) = Eigen::Map<const Eigen::VectorXd>(system.point_step(p), 3);
    }
    return d;
  }
};

template <int N>
void expect_dense_solution(RandomBundle<N>& bundle, double damping) {
  const LmStep step = bundle.system.solve(damping, bundle.team);
  ASSERT_TRUE(step.valid);
  Eigen::MatrixXd damped = bundle.h;
  for (int k = 0; k < damped.rows(); ++k) {
    damped(k, k) = damped(k, k) == 0 ? damping : damped(k, k) * (1 + damping);
  }
  const Eigen::VectorXd expected = damped.ldlt().solve(-bundle.g), found = bundle.step();
  EXPECT_LE((found - expected).norm(), 1e-8 * expected.norm());
  const double model = -bundle.g.dot(expected) - 0.5 * expected.dot(bundle.h * expected);
  EXPECT_NEAR(step.decrease, model, 1e-9 * model);
}

TEST(SchurSystem, SolvesAgainForOtherGradientsOfThePoses) {
  RandomBundle<6> bundle(40, 300, 6, 3);
  constexpr double kDamping = 1e-3;
  const auto slots = static_cast<int>(bundle.pose_of_slot.size());
  std::vector<std::array<double, kCrossSize<6>>> crosses(slots);
  for (int s = 0; s < slots; ++s) std::copy_n(bundle.system.cross(s), kCrossSize<6>, crosses[s].begin());
  ASSERT_TRUE(bundle.system.solve(kDamping, bundle.team).valid);
  Rng rng(8);
  for (int i = 0; i < bundle.poses; ++i) {
    for (double& g : bundle.system.pose(i).gradient) g = rng.normal();
  }
  for (int p = 0; p < bundle.points; ++p) std::fill_n(bundle.system.point(p).gradient, 3, 0.0);
  ASSERT_TRUE(bundle.system.solve_again(kDamping, bundle.team).valid);
  const Eigen::VectorXd again = bundle.step();
  for (int s = 0; s < slots; ++s) std::ranges::copy(crosses[s], bundle.system.cross(s));
  ASSERT_TRUE(bundle.system.solve(kDamping, bundle.team).valid);
  EXPECT_LT((again - bundle.step()).norm(), 1e-12 * again.norm());
}

TEST(SchurSystem, IsTheDenseSolution) {
  struct {
    int poses, points, longest_track;
  } cases[] = {{1, 5, 1}, {3, 40, 3}, {24, 50, 8}, {25, 50, 8}, {40, 60, 6}, {30, 40, 30}};
  for (const auto& c : cases) {
    for (double damping : {1e-6, 1e-2, 10.0}) {
      SCOPED_TRACE(testing::Message() << c.poses << " poses, damping " << damping);
      RandomBundle<6> bundle(c.poses, c.points, c.longest_track, c.poses);
      expect_dense_solution(bundle, damping);
      RandomBundle<9> with_lenses(c.poses, c.points, c.longest_track, c.poses);
      expect_dense_solution(with_lenses, damping);
    }
  }
}

TEST(SchurSystem, TellsWhatAPointGainsByItself) {
  RandomBundle<6> bundle(12, 40, 6, 5);
  ASSERT_TRUE(bundle.system.solve(1e-12, bundle.team).valid);
  for (int p = 0; p < bundle.points; ++p) {
    const Eigen::Matrix3d v = bundle.h.block<3, 3>(6 * bundle.poses + 3 * p, 6 * bundle.poses + 3 * p);
    const Eigen::Vector3d g = bundle.g.segment<3>(6 * bundle.poses + 3 * p);
    const double gain = 0.5 * g.dot(v.ldlt().solve(g));
    EXPECT_NEAR(bundle.system.decrease_of_point(p), gain, 1e-8 * gain);
  }
}

TEST(SchurSystem, PosesAloneAndPointsAlone) {
  RandomBundle<6> points_only(0, 20, 0, 3);
  expect_dense_solution(points_only, 1e-3);
  RandomBundle<6> poses_only(2, 0, 0, 3);
  expect_dense_solution(poses_only, 1e-3);  // nothing observed: nothing moves
}

TEST(SchurSystem, WhatIsNotObservedStays) {
  RandomBundle<6> bundle(4, 30, 2, 8);
  std::fill_n(bundle.system.pose(1).u, 36, 0.0);
  std::fill_n(bundle.system.pose(1).gradient, 6, 0.0);
  for (int s = 0; s < bundle.system.slot_count(); ++s) {
    if (bundle.pose_of_slot[s] == 1) std::fill_n(bundle.system.cross(s), kCrossSize<6>, 0.0);
  }
  ASSERT_TRUE(bundle.system.solve(1e-4, bundle.team).valid);
  for (int k = 0; k < 6; ++k) EXPECT_EQ(bundle.system.pose_step(1)[k], 0.0);
}

TEST(SchurSystem, NotFiniteIsNotValid) {
  RandomBundle<6> bundle(4, 30, 3, 8);
  bundle.system.point(5).gradient[1] = NAN;
  EXPECT_FALSE(bundle.system.solve(1e-4, bundle.team).valid);
  bundle.system.point(5).gradient[1] = 0;
  bundle.system.pose(2).u[0] = INFINITY;
  EXPECT_FALSE(bundle.system.solve(1e-4, bundle.team).valid);
}

// A point held by one ray: V has rank two and only the damping keeps it apart from singular.
TEST(SchurSystem, PointOnOneRay) {
  const double a[3] = {1, 2, 3}, b[3] = {2, -1, 0.5};
  for (double damping : {1e-10, 1e-4}) {
    RandomBundle<6> bundle(3, 20, 3, 4);
    PointBlock& point = bundle.system.point(0);
    int k = 0;
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) point.v[k++] = a[i] * a[j] + b[i] * b[j];
    }
    for (int s = bundle.point_begin[0]; s < bundle.point_begin[1]; ++s)
      std::fill_n(bundle.system.cross(s), kCrossSize<6>, 0);
    for (int i = 0; i < 3; ++i) point.gradient[i] = a[i] + b[i];
    ASSERT_TRUE(bundle.system.solve(damping, bundle.team).valid);
    // The step undoes a and b: a . d = -1 and b . d = -1.
    const double* d = bundle.system.point_step(0);
    EXPECT_NEAR(a[0] * d[0] + a[1] * d[1] + a[2] * d[2], -1, 1e-3);
    EXPECT_NEAR(b[0] * d[0] + b[1] * d[1] + b[2] * d[2], -1, 1e-3);
  }
}

template <int N>
void expect_same_bits() {
  std::vector<Eigen::VectorXd> steps;
  const auto solve = [&](int threads) {
    RandomBundle<N> bundle(30, 1500, 8, 2, threads, false);  // more points than one thread takes at a time
    ASSERT_TRUE(bundle.system.solve(1e-4, bundle.team).valid);
    steps.push_back(bundle.step());
  };
  testing_support::for_each_instruction_set([&](const char*) { solve(1); });
  for (int threads : {2, 3}) solve(threads);
  for (const Eigen::VectorXd& step : steps) EXPECT_EQ(step, steps.front());
}

TEST(SchurSystem, InstructionSetsAndThreadsChangeNoBit) {
  expect_same_bits<6>();
  expect_same_bits<9>();
}

}  // namespace
}  // namespace raysfm
