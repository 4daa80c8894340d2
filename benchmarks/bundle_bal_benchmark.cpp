// Global adjustment of problems in the form of Bundle Adjustment in the Large, nine unknowns for each camera,
// against Ceres with analytic derivatives and each of its Schur solvers, in pairs within one run. Both start
// from the same numbers and stop on the same rule. Ceres's time is that of its minimiser and preprocessor,
// without the building of its problem; ours is everything.
//
//   bundle_bal_benchmark [runs] [problem...]
//
// A problem is `kitchen` or `ladybug`, both disturbed; `ladybug-pre`, as it is; or a number: the cameras of a
// simulated road.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "raysfm/core/timer.h"
#include "support/bundle_scene.h"
#include "support/shared_data.h"
#ifdef RAYSFM_HAVE_CERES
#include "support/ceres_bundle.h"
#endif

namespace raysfm {
namespace {

constexpr int kMostIterations = 50;
constexpr double kLeastDecrease = 1e-6;
constexpr double kMostSeconds = 120;  // of a rival on one problem

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

bool read(const std::string& path, BalProblem* problem) {
  FILE* file = popen(("bzcat '" + path + "'").c_str(), "r");
  int cameras = 0, points = 0, observations = 0;
  bool ok = file && std::fscanf(file, "%d %d %d", &cameras, &points, &observations) == 3;
  for (int i = 0; ok && i < observations; ++i) {
    BalProblem::Observation o;
    ok = std::fscanf(file, "%d %d %lf %lf", &o.camera, &o.point, &o.pixel.x(), &o.pixel.y()) == 4;
    problem->observations.push_back(o);
  }
  problem->cameras.resize(cameras);
  problem->points.resize(points);
  for (auto& camera : problem->cameras) {
    for (double& x : camera) ok = ok && std::fscanf(file, "%lf", &x) == 1;
  }
  for (auto& point : problem->points) {
    for (double& x : point) ok = ok && std::fscanf(file, "%lf", &x) == 1;
  }
  if (file) pclose(file);
  return ok;
}

constexpr double kRotation = 0.01, kTranslation = 0.05, kPoint = 0.05;  // sigma of the disturbance

// Turns the cameras of a road about their own centres: about the origin of the world, a hundredth of a radian
// would throw the far ones off the road.
void disturb_road(BalProblem* problem) {
  Rng rng(1);
  for (std::array<double, 9>& c : problem->cameras) {
    const Eigen::Quaterniond rotation = exp_so3({c[0], c[1], c[2]});
    const Eigen::Quaterniond turned = exp_so3(test::random_vector(rng, kRotation)) * rotation;
    const Eigen::Vector3d t = turned * (rotation.conjugate() * Eigen::Vector3d(c[3], c[4], c[5])) +
                              test::random_vector(rng, kTranslation);
    const Eigen::Vector3d w = log_so3(turned);
    for (int k = 0; k < 3; ++k) c[k] = w[k], c[3 + k] = t[k];
  }
  for (Eigen::Vector3d& x : problem->points) x += test::random_vector(rng, kPoint);
}

bool make(const std::string& name, BalProblem* problem) {
  const std::string folder = testing_support::shared_data("bal").string() + "/";
  if (std::atoi(name.c_str()) > 0) {
    *problem = test::make_bal_scene({.cameras = std::atoi(name.c_str())});
    disturb_road(problem);
    return true;
  }
  const bool kitchen = name == "kitchen";
  if (!read(folder + (kitchen ? "kitchen-100-11726.txt.bz2" : "problem-49-7776-pre.txt.bz2"), problem)) {
    return false;
  }
  if (name != "ladybug-pre") test::perturb(problem, kRotation, kTranslation, kPoint, 1);
  return true;
}

struct Rival {
  std::string name;
  std::vector<double> ms;
  double cost = 0;
  int iterations = 0;
  bool stopped = false;
};

void report(const Rival& r, const std::vector<double>& ours) {
  std::vector<double> ratio;
  for (size_t i = 0; i < r.ms.size(); ++i) ratio.push_back(r.ms[i] / ours[i]);
  std::printf("  %-28s %9.1f ms  %2d iterations  cost %.9g  takes %.2f of our time%s\n", r.name.c_str(),
              median(r.ms), r.iterations, r.cost, median(ratio), r.stopped ? ", stopped before its end" : "");
}

void run(const std::string& name, int runs) {
  BalProblem start;
  if (!make(name, &start)) {
    std::printf("%s: not found\n", name.c_str());
    return;
  }
  std::printf("%s: %zu cameras, %zu points, %zu observations; medians of %d runs\n", name.c_str(),
              start.cameras.size(), start.points.size(), start.observations.size(), runs);
  for (int threads : {1, 2}) {
    std::vector<Rival> rivals = {{"raysfm", {}}};
#ifdef RAYSFM_HAVE_CERES
    const ceres::LinearSolverType solvers[] = {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR,
                                               ceres::ITERATIVE_SCHUR};
    for (ceres::LinearSolverType solver : solvers) {
      rivals.push_back({std::string("Ceres ") + ceres::LinearSolverTypeToString(solver), {}});
    }
#endif
    for (int i = 0; i < runs; ++i) {
      for (size_t k = 0; k < rivals.size(); ++k) {
        BalProblem problem = start;
        const Clock::time_point begin = Clock::now();
        if (k == 0) {
          const BundleSummary summary = adjust_bal(&problem, {.max_iterations = kMostIterations,
                                                              .min_relative_decrease = kLeastDecrease,
                                                              .threads = threads});
          rivals[k].ms.push_back(milliseconds_since(begin));
          rivals[k].cost = summary.final_cost;
          rivals[k].iterations = summary.iterations;
        }
#ifdef RAYSFM_HAVE_CERES
        if (k > 0) {
          // Ceres factorises a dense matrix of 9000 rows in minutes.
          if (solvers[k - 1] == ceres::DENSE_SCHUR && start.cameras.size() > 250) continue;
          const auto summary = test::adjust_with_ceres(problem, {.max_iterations = kMostIterations,
                                                                 .function_tolerance = kLeastDecrease,
                                                                 .solver = solvers[k - 1],
                                                                 .threads = threads,
                                                                 .max_seconds = kMostSeconds});
          rivals[k].ms.push_back(1e3 * summary.total_time_in_seconds);
          rivals[k].cost = summary.final_cost;
          rivals[k].iterations = static_cast<int>(summary.iterations.size()) - 1;
          rivals[k].stopped |= summary.total_time_in_seconds > kMostSeconds;
        }
#endif
      }
    }
    std::printf(" %d thread%s\n", threads, threads > 1 ? "s" : "");
    for (const Rival& rival : rivals) {
      if (!rival.ms.empty()) report(rival, rivals[0].ms);
    }
  }
}

}  // namespace
}  // namespace raysfm

int main(int argc, char** argv) {
  const int runs = argc > 1 ? std::max(1, std::atoi(argv[1])) : 3;
  std::vector<std::string> names(argv + std::min(argc, 2), argv + argc);
  if (names.empty()) names = {"kitchen", "ladybug", "ladybug-pre", "50", "100", "200", "500", "1000"};
  for (const std::string& name : names) raysfm::run(name, runs);
}
