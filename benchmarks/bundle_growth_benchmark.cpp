// Growth of the cost of bundle adjustment along a sequence (LBA09 2.6), in milliseconds for a key frame: the
// window of the local adjustment; the hierarchical scheme over the whole sequence, divided by its key frames;
// everything adjusted when a key frame comes. Before that table 1 of the paper, whose gains are ratios of
// counted operations, as measured times of one iteration. Single runs; the local figures are medians. One
// thread.
//
//   bundle_growth_benchmark [largest number of key frames] [chart.png]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "line_chart.h"
#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/bundle/bundle_methods.h"
#include "raysfm/core/timer.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

constexpr int kTrack = 5;

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// A sequence with 150 points in an image.
test::BundleScene sequence(int poses) {
  return test::make_bundle_scene(
      {.poses = poses, .free_poses = poses, .points = 30 * poses, .track = kTrack});
}

// The last `window` poses of a scene, of which the last `free` move, with what they see.
test::BundleScene last_window(const test::BundleScene& scene, int window, int free) {
  const int first = static_cast<int>(scene.poses.size()) - window;
  test::BundleScene part;
  part.cameras = scene.cameras;
  part.poses.assign(scene.poses.begin() + first, scene.poses.end());
  for (int i = 0; i < window; ++i) part.pose_is_free.push_back(i >= window - free);
  std::vector<int> local(scene.points.size(), -1);
  for (const BundleObservation& o : scene.observations) {
    if (o.pose >= static_cast<int>(scene.poses.size()) - free) local[o.point] = 0;
  }
  for (size_t p = 0; p < local.size(); ++p) {
    if (local[p] < 0) continue;
    local[p] = static_cast<int>(part.points.size());
    part.points.push_back(scene.points[p]);
  }
  for (BundleObservation o : scene.observations) {
    if (o.pose < first || local[o.point] < 0) continue;
    o.pose -= first, o.point = local[o.point];
    part.observations.push_back(o);
  }
  part.is_inlier.assign(part.observations.size(), 1);
  return part;
}

// Processor time of one thread, so that other programs do not count: milliseconds.
double time_of(const test::BundleScene& start, int iterations, int runs) {
  BundleAdjuster adjuster;
  std::vector<double> ms;
  for (int i = 0; i < runs; ++i) {
    test::BundleScene scene = start;
    const std::clock_t begin = std::clock();
    adjuster.adjust(scene.problem(), {.max_iterations = iterations, .min_relative_decrease = 0});
    ms.push_back(1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  return median(ms);
}

void table_1() {
  constexpr int kRuns = 301;
  // Ten iterations less one, so that setting up is not counted.
  const auto iteration = [&](const test::BundleScene& s) {
    return (time_of(s, 10, kRuns) - time_of(s, 1, kRuns)) / 9;
  };
  const test::BundleScene scene = sequence(20);
  double global = 0;  // the first row's
  std::printf("table 1: one iteration, 20 key frames, 150 points in an image; medians of %d runs\n", kRuns);
  const struct {
    const char* name;
    int free, window;
    double gain;
  } rows[] = {{"global", 20, 20, 1}, {"reduction 1", 5, 20, 10}, {"reduction 2", 3, 10, 25}};
  for (const auto& row : rows) {
    const double ms = iteration(last_window(scene, row.window, row.free));
    if (global == 0) global = ms;
    std::printf("  %-12s n %2d  N %2d  %.4f ms  gain %5.1f  (paper %2.0f)\n", row.name, row.free, row.window,
                ms, global / ms, row.gain);
  }
}

void growth(int largest, const char* picture) {
  LineChart chart{"key frames",
                  "log10 of milliseconds for a key frame",
                  {},
                  {{"local", {}}, {"hierarchical", {}}, {"global", {}}}};
  std::printf("growth: milliseconds for a key frame\n");
  for (int poses = 62; poses <= largest; poses = poses * 2 + 1) {
    const test::BundleScene start = sequence(poses);
    const auto time_method = [&](BundleMethod method) {
      test::BundleScene scene = start;
      const Clock::time_point begin = Clock::now();
      adjust(scene.problem(), method, {});
      return milliseconds_since(begin);
    };
    const double local = time_of(last_window(start, 10, 3), 10, 101);
    const double hierarchical = time_method(BundleMethod::kHierarchical) / poses;
    const double global = time_method(BundleMethod::kGlobal);
    std::printf("  %5d key frames  local %.3f  hierarchical %.2f  global %.0f\n", poses, local, hierarchical,
                global);
    chart.x.push_back(poses);
    const double ms[3] = {local, hierarchical, global};
    for (int i = 0; i < 3; ++i) chart.series[i].y.push_back(std::log10(ms[i]));
  }
  if (picture && chart.x.size() > 1) draw_charts({chart}, picture);
}

}  // namespace
}  // namespace raysfm

int main(int argc, char** argv) {
  raysfm::table_1();
  raysfm::growth(argc > 1 ? std::atoi(argv[1]) : 2100, argc > 2 ? argv[2] : nullptr);
}
