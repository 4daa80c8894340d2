// Local bundle adjustment against Ceres, in pairs within one run, one thread.
#include <algorithm>
#include <cstdio>
#include <vector>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/core/timer.h"
#include "support/bundle_scene.h"
#include "support/ceres_bundle.h"

namespace raysfm {
namespace {

struct Case {
  const char* name;
  test::BundleSceneOptions scene;
  ceres::LinearSolverType solver;
  int runs;
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

void run(const Case& c) {
  const test::BundleScene start = test::make_bundle_scene(c.scene);
  BundleAdjuster adjuster;
  std::vector<double> ours_ms, ceres_ms, ceres_solver_ms, ratios;
  BundleSummary ours;
  ceres::Solver::Summary theirs;
  for (int i = 0; i < c.runs; ++i) {
    test::BundleScene a = start, b = start;
    Clock::time_point begin = Clock::now();
    ours = adjuster.adjust(a.problem(), {});
    ours_ms.push_back(milliseconds_since(begin));
    begin = Clock::now();
    theirs = test::adjust_with_ceres(b, {.solver = c.solver});
    ceres_ms.push_back(milliseconds_since(begin));
    ceres_solver_ms.push_back(1e3 * theirs.minimizer_time_in_seconds);
    ratios.push_back(ceres_solver_ms.back() / ours_ms.back());
  }
  std::printf("%s: %zu poses, %zu points, %zu observations, %d runs\n", c.name, start.poses.size(),
              start.points.size(), start.observations.size(), c.runs);
  std::printf("  raysfm              %9.3f ms  %d iterations, cost %.9g -> %.9g\n", median(ours_ms),
              ours.iterations, ours.initial_cost, ours.final_cost);
  std::printf("  Ceres, minimiser    %9.3f ms  %zu iterations, cost %.9g -> %.9g\n", median(ceres_solver_ms),
              theirs.iterations.size() - 1, theirs.initial_cost, theirs.final_cost);
  std::printf("  Ceres, with set-up  %9.3f ms\n", median(ceres_ms));
  std::printf("  median ratio, minimiser alone to all of raysfm: %.1f; cost difference %.1e\n",
              median(ratios), ours.final_cost / theirs.final_cost - 1);
}

}  // namespace
}  // namespace raysfm

int main() {
  using raysfm::run;
  run({"local window", {}, ceres::DENSE_SCHUR, 301});
  run({"start, all free", {.poses = 20, .free_poses = 20, .points = 1500}, ceres::DENSE_SCHUR, 51});
  run({"global", {.poses = 200, .free_poses = 200, .points = 20000}, ceres::SPARSE_SCHUR, 5});
}
