// Bundle adjustment against Ceres with analytic derivatives, in pairs within one run, one thread each. Both
// start from the same scene and stop on the same rule. Ceres's time is that of its minimiser alone and,
// apart, with the set-up of its problem; ours is everything.
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/core/timer.h"
#include "support/bundle_scene.h"
#ifdef RAYSFM_HAVE_CERES
#include "support/ceres_bundle.h"
#endif

namespace raysfm {
namespace {

struct Case {
  const char* name;
  test::BundleSceneOptions scene;
  bool sparse;  // what Ceres is told
  int runs;
};

struct Times {
  std::vector<double> ours, minimiser, with_setup, ratio, ratio_with_setup;
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

double least(const std::vector<double>& values) {
  return *std::min_element(values.begin(), values.end());
}

#ifdef RAYSFM_HAVE_CERES
double run_ceres(const Case& c, const test::BundleScene& start, Times* times) {
  test::BundleScene scene = start;
  const Clock::time_point begin = Clock::now();
  const ceres::Solver::Summary summary =
      test::adjust_with_ceres(scene, {.solver = c.sparse ? ceres::SPARSE_SCHUR : ceres::DENSE_SCHUR});
  times->with_setup.push_back(milliseconds_since(begin));
  times->minimiser.push_back(1e3 * summary.minimizer_time_in_seconds);
  times->ratio.push_back(times->minimiser.back() / times->ours.back());
  times->ratio_with_setup.push_back(times->with_setup.back() / times->ours.back());
  return summary.final_cost;
}
#endif

void run(const Case& c) {
  const test::BundleScene start = test::make_bundle_scene(c.scene);
  BundleAdjuster adjuster;
  Times times;
  BundleSummary summary;
  double rival_cost = 0;
  for (int i = 0; i < c.runs; ++i) {
    test::BundleScene scene = start;
    const Clock::time_point begin = Clock::now();
    summary = adjuster.adjust(scene.problem(), {});
    times.ours.push_back(milliseconds_since(begin));
#ifdef RAYSFM_HAVE_CERES
    rival_cost = run_ceres(c, start, &times);
#endif
  }
  std::printf("%s: %zu poses, %d free, %zu points, %zu observations; medians of %d runs\n", c.name,
              start.poses.size(), c.scene.free_poses, start.points.size(), start.observations.size(), c.runs);
  std::printf("  raysfm %.3f ms, %d iterations, %s, cost %.9g -> %.9g\n", median(times.ours),
              summary.iterations, std::string(to_string(summary.termination)).c_str(), summary.initial_cost,
              summary.final_cost);
  if (times.ratio.empty()) return;
  std::printf("  Ceres  %.3f ms (least %.3f), %.3f ms with set-up, final cost %.9g\n",
              median(times.minimiser), least(times.minimiser), median(times.with_setup), rival_cost);
  std::printf("  faster by %.1f (least to least %.1f), %.1f with set-up; final cost differs by %.1e of it\n",
              median(times.ratio), least(times.minimiser) / least(times.ours), median(times.ratio_with_setup),
              summary.final_cost / rival_cost - 1);
}

}  // namespace
}  // namespace raysfm

int main() {
  using raysfm::run;
  run({"local window", {}, false, 301});
  run({"start of a sequence", {.poses = 20, .free_poses = 20, .points = 1500}, false, 51});
  run({"global", {.poses = 200, .free_poses = 200, .points = 20000}, true, 7});
  run({"global, long tracks", {.poses = 200, .free_poses = 200, .points = 5000, .track = 20}, true, 7});
}
