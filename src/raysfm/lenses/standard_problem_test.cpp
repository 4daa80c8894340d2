#include "raysfm/lenses/standard_problem.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <atomic>
#include <cstdlib>
#include <new>
#include <vector>

#include "support/instruction_sets.h"
#include "support/test_scenes.h"

namespace {
std::atomic<long> allocations{0};
}  // namespace

// Those of Eigen go past operator new; a sanitizer has its own malloc.
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define RAYSFM_COUNTS_MALLOC
extern "C" void* __libc_malloc(size_t size);
extern "C" void* malloc(size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
#endif

namespace raysfm {
namespace {

using test_scenes::add_noise;
using test_scenes::Cube;
using test_scenes::make_cube;
using test_scenes::perturbed;

struct ProblemCase {
  const char* name;
  LensConstraints constraints;
};
void PrintTo(const ProblemCase& c, std::ostream* out) {
  *out << c.name;
}

class StandardStep : public testing::TestWithParam<ProblemCase> {
 protected:
  void SetUp() override {
    Rng rng(41);
    cube_ = make_cube({.images = 4, .points = 12, .zooming = !GetParam().constraints.equal}, &rng);
    add_noise(1.0, &rng, &cube_.tracks);
    scene_ = perturbed(cube_.truth, 0.02, &rng);
    options_.constraints = GetParam().constraints;
    options_.constraints.principal_point = {255, 245};
    const Lens mean = scene_.lenses[0];
    for (Lens& lens : scene_.lenses) {
      lens = constrained(GetParam().constraints.equal ? mean : lens, options_.constraints);
    }
    index_ = index_observations(cube_.tracks, {}, &scene_, kMinPointsPerImage, 2);
  }

  // Residuals where `step` leads, in the order of StandardProblem::step().
  Eigen::VectorXd residuals(const Eigen::VectorXd& step) const {
    const LensConstraints& c = options_.constraints;
    const Eigen::MatrixXd basis = lens_basis(c);
    const int images = index_.image_count(), p = static_cast<int>(basis.cols()), block = c.equal ? 6 : 6 + p;
    std::vector<double> values;
    const auto lens_of = [&](int j) {
      const Eigen::VectorXd change = step.segment(c.equal ? 6 * images : block * j + 6, p);
      return Lens::from_vector(scene_.lenses[j].vector() + basis * change);
    };
    const int camera_numbers = block * images + (c.equal ? p : 0);
    for (int k = 0; k < cube_.tracks.size(); ++k) {
      const int j = cube_.tracks.image[k], i = cube_.tracks.point[k];
      const Rigid3 pose = retract(scene_.cam_from_world[j], step.segment<6>(block * j));
      const Eigen::Vector3d x = pose * (scene_.points[i] + step.segment<3>(camera_numbers + 3 * i));
      const Eigen::Vector2d r = lens_of(j).pixel(x.head<2>() / x.z()) - cube_.tracks.pixel[k];
      values.insert(values.end(), {r.x(), r.y()});
    }
    for (int j = 0; j < (c.equal ? 1 : images) && c.principal_point_sigma > 0; ++j) {
      const Lens lens = lens_of(j);
      values.push_back((lens.cx - c.principal_point.x()) / c.principal_point_sigma);
      values.push_back((lens.cy - c.principal_point.y()) / c.principal_point_sigma);
    }
    for (int j = 0; j < (c.equal ? 1 : images) && c.focal_sigma > 0; ++j) {
      values.push_back((lens_of(j).fx - c.focal) / c.focal_sigma);
    }
    return Eigen::Map<Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  }

  Cube cube_;
  UncalibratedScene scene_;
  LensAdjustmentOptions options_;
  ObservationIndex index_;
};

// The eliminated system against dense normal equations from numeric derivatives, every size of block.
TEST_P(StandardStep, IsThatOfTheDenseSystem) {
  constexpr double kDamping = 1e-2, kStep = 1e-6;
  StandardProblem problem(index_, options_, scene_, LensRole::kUnknown);
  const double cost = problem.linearize();
  ASSERT_TRUE(problem.solve(kDamping).valid);
  const Eigen::VectorXd step = problem.step();
  const int n = static_cast<int>(step.size());
  const Eigen::VectorXd r = residuals(Eigen::VectorXd::Zero(n));
  EXPECT_NEAR(cost, 0.5 * r.squaredNorm(), 1e-9 * cost);
  Eigen::MatrixXd jacobian(r.size(), n);
  for (int k = 0; k < n; ++k) {
    const Eigen::VectorXd e = kStep * Eigen::VectorXd::Unit(n, k);
    jacobian.col(k) = (residuals(e) - residuals(-e)) / (2 * kStep);
  }
  Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
  normal.diagonal() *= 1 + kDamping;
  const Eigen::VectorXd expected = normal.ldlt().solve(-jacobian.transpose() * r);
  EXPECT_LT((step - expected).norm(), 1e-5 * expected.norm());
}

TEST_P(StandardStep, InstructionSetsChangeNoBit) {
  std::vector<Eigen::VectorXd> steps;
  testing_support::for_each_instruction_set([&](const char*) {
    StandardProblem problem(index_, options_, scene_, LensRole::kUnknown);
    problem.linearize();
    ASSERT_TRUE(problem.solve(1e-2).valid);
    steps.push_back(problem.step());
  });
  for (const Eigen::VectorXd& step : steps) EXPECT_EQ(step, steps.front());
}

TEST_P(StandardStep, ThreadsChangeNoBit) {
  for (const LensRole role : {LensRole::kUnknown, LensRole::kDependent}) {
    std::vector<Eigen::VectorXd> steps;
    for (const int threads : {1, 3}) {
      options_.threads = threads;
      StandardProblem problem(index_, options_, scene_, role);
      problem.linearize();
      ASSERT_TRUE(problem.solve(1e-2).valid);
      steps.push_back(problem.step());
    }
    EXPECT_EQ(steps[0], steps[1]);
  }
}

// No change of its numbers makes a fitted lens better.
TEST_P(StandardStep, DependentLensesFitBest) {
  StandardProblem problem(index_, options_, scene_, LensRole::kDependent);
  LmOptions lm{.max_iterations = 40, .min_relative_decrease = 1e-12};
  levenberg_marquardt(problem, lm);
  scene_ = problem.scene();
  const Eigen::MatrixXd basis = lens_basis(options_.constraints);
  const int images = index_.image_count(), p = static_cast<int>(basis.cols());
  const bool equal = options_.constraints.equal;
  const int n = (equal ? 6 * images + p : (6 + p) * images) + 3 * index_.point_count();
  const double least = residuals(Eigen::VectorXd::Zero(n)).squaredNorm();
  for (int k = 0; k < p; ++k) {
    for (const double change : {-0.1, 0.1}) {
      const Eigen::VectorXd moved = change * Eigen::VectorXd::Unit(n, (equal ? 6 * images : 6) + k);
      EXPECT_GT(residuals(moved).squaredNorm(), least) << k;
    }
  }
}

TEST_P(StandardStep, AllocatesNothingOnceMemoryIsSetUp) {
#ifndef RAYSFM_COUNTS_MALLOC
  GTEST_SKIP() << "malloc is not counted here";
#endif
  for (const LensRole role : {LensRole::kUnknown, LensRole::kDependent}) {
    StandardProblem problem(index_, options_, scene_, role);
    problem.linearize();
    const long before = allocations;
    for (int k = 0; k < 5; ++k) {
      problem.solve(1e-3);
      problem.evaluate(true);
      problem.accept();
    }
    EXPECT_EQ(allocations - before, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(
    , StandardStep,
    testing::Values(ProblemCase{"fixed", {.zero_skew = false, .unit_aspect = false, .equal = true}},
                    ProblemCase{"fixed_prior", {.equal = true, .principal_point_sigma = 20}},
                    ProblemCase{"zoom", {}}, ProblemCase{"zoom_prior", {.principal_point_sigma = 20}},
                    ProblemCase{"fixed_focal_prior",
                                {.equal = true, .principal_point_sigma = 20, .focal_sigma = 8, .focal = 930}},
                    ProblemCase{"zoom_focal_prior", {.unit_aspect = false, .focal_sigma = 8, .focal = 930}},
                    ProblemCase{"focal_length_alone",
                                {.known_principal_point = true, .principal_point = {255, 245}}},
                    ProblemCase{"five_numbers_each",
                                {.zero_skew = false, .unit_aspect = false, .principal_point_sigma = 5}}),
    [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace raysfm
