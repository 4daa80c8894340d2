// Milliseconds of the adjustment of a graph of similarities whose loop is to be closed, beside Ceres (sparse
// Cholesky, one thread, derivatives by itself) on the same graph. Usage: graph_benchmark

#include <algorithm>
#include <cstdio>

#include "raysfm/core/timer.h"
#include "raysfm/places/pose_graph.h"
#include "support/drifted_loop.h"
#ifdef RAYSFM_HAVE_CERES
#include "support/ceres_graph.h"
#endif

namespace {

using namespace raysfm;

constexpr int kRuns = 5;

template <typename Run>
double fastest_ms(const Run& run) {
  double fastest = 1e30;
  for (int i = 0; i < kRuns; ++i) {
    const Clock::time_point start = Clock::now();
    run();
    fastest = std::min(fastest, milliseconds_since(start));
  }
  return fastest;
}

void benchmark(int nodes, bool scale_is_known) {
  const test::DriftedLoop drifted =
      test::drifted_loop({.nodes = nodes, .reach = 3, .loop_edges = 5, .scale_is_known = scale_is_known});
  const std::vector<uint8_t> is_free = test::all_but_first(drifted.nodes.size());
  test::DriftedLoop loop;
  LmSummary ours;
  const double our_ms = fastest_ms([&] {
    loop = drifted;
    ours = adjust_graph(loop.nodes, is_free, loop.edges, {.scale_is_known = scale_is_known});
  });
  std::printf("%5d nodes %5zu edges, scale %s: raysfm %7.1f ms %2d solves, cost %.6g, error %.3g -> %.3g\n",
              nodes, loop.edges.size(), scale_is_known ? "known  " : "unknown", our_ms, ours.iterations,
              ours.final_cost, test::center_error(drifted), test::center_error(loop));
#ifdef RAYSFM_HAVE_CERES
  ceres::Solver::Summary theirs;
  const double their_ms = fastest_ms(
      [&] { theirs = test::adjust_graph_with_ceres(drifted.nodes, drifted.edges, scale_is_known, 1e-9); });
  std::printf("%43s: Ceres  %7.1f ms %2zu solves, cost %.6g\n", "", their_ms, theirs.iterations.size() - 1,
              theirs.final_cost);
#endif
}

}  // namespace

int main() {
  for (const int nodes : {1000, 5000}) {
    for (const bool scale_is_known : {false, true}) benchmark(nodes, scale_is_known);
  }
}
