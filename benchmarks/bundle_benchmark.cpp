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

// Full normal equations of all unknowns at once, Gauss and Newton's steps by Eigen's dense LDLT: what a local
// window costs without the structure of appendix A. Returns milliseconds.
double run_dense(const test::BundleScene& start, int free_poses, int iterations) {
  test::BundleScene scene = start;
  const Pinhole camera = std::get<Pinhole>(scene.cameras[0].model);
  const Clock::time_point begin = Clock::now();
  const int first_free = static_cast<int>(scene.poses.size()) - free_poses, points = 6 * free_poses;
  const Eigen::Index size = points + 3 * static_cast<Eigen::Index>(scene.points.size());
  for (int i = 0; i < iterations; ++i) {
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd g = Eigen::VectorXd::Zero(size);
    for (const BundleObservation& o : scene.observations) {
      const Eigen::Vector3d x = scene.poses[o.pose] * scene.points[o.point];
      Eigen::Vector2d pixel;
      Eigen::Matrix<double, 2, 3> a;
      if (!camera.project(x, &pixel, &a)) continue;
      Eigen::Matrix<double, 2, 9> j;
      j << a, -a * skew(x), a * scene.poses[o.pose].rotation.toRotationMatrix();
      const Eigen::Index pose = 6 * (o.pose - first_free), point = points + 3 * o.point;
      const Eigen::Vector2d r = pixel - o.pixel;
      h.block<3, 3>(point, point) += j.rightCols<3>().transpose() * j.rightCols<3>();
      g.segment<3>(point) += j.rightCols<3>().transpose() * r;
      if (o.pose < first_free) continue;
      h.block<6, 6>(pose, pose) += j.leftCols<6>().transpose() * j.leftCols<6>();
      h.block<3, 6>(point, pose) += j.rightCols<3>().transpose() * j.leftCols<6>();
      g.segment<6>(pose) += j.leftCols<6>().transpose() * r;
    }
    h.diagonal() *= 1 + 1e-4;
    const Eigen::VectorXd step = h.selfadjointView<Eigen::Lower>().ldlt().solve(-g);
    for (int k = 0; k < free_poses; ++k) {
      scene.poses[first_free + k] = retract(scene.poses[first_free + k], step.segment<6>(6 * k));
    }
    for (size_t p = 0; p < scene.points.size(); ++p) scene.points[p] += step.segment<3>(points + 3 * p);
  }
  return milliseconds_since(begin);
}

// The window of the paper: ten iterations, whatever they gain.
void run_window() {
  constexpr int kRuns = 301, kIterations = 10;
  const test::BundleScene start = test::make_bundle_scene({});
  BundleAdjuster adjuster;
  std::vector<double> ours, dense;
  Times rival;
  for (int i = 0; i < kRuns; ++i) {
    test::BundleScene scene = start;
    const Clock::time_point begin = Clock::now();
    adjuster.adjust(scene.problem(), {.max_iterations = kIterations, .min_relative_decrease = 0});
    ours.push_back(milliseconds_since(begin));
#ifdef RAYSFM_HAVE_CERES
    scene = start;
    const ceres::Solver::Summary summary =
        test::adjust_with_ceres(scene, {.max_iterations = kIterations, .function_tolerance = 0});
    rival.minimiser.push_back(1e3 * summary.minimizer_time_in_seconds);
    rival.ratio.push_back(rival.minimiser.back() / ours.back());
#endif
    if (i % 100 == 0) dense.push_back(run_dense(start, 3, kIterations) / ours.back());
  }
  std::printf(
      "local window, %d iterations: 10 poses, 3 free, %zu points, %zu observations; medians of %d runs\n",
      kIterations, start.points.size(), start.observations.size(), kRuns);
  std::printf("  raysfm %.3f ms (least %.3f); dense LDLT takes %.0f of our time\n", median(ours), least(ours),
              median(dense));
  if (rival.ratio.empty()) return;
  std::printf("  Ceres  %.3f ms (least %.3f), faster by %.1f (least to least %.1f)\n",
              median(rival.minimiser), least(rival.minimiser), median(rival.ratio),
              least(rival.minimiser) / least(ours));
}

// The three errors from the same start on the same pixels.
void run_errors(const char* name, const test::BundleSceneOptions& options) {
  constexpr int kRuns = 201;
  const test::BundleScene start = test::make_bundle_scene(options);
  std::printf("%s: %zu observations, from the same start; medians of %d runs\n", name,
              start.observations.size(), kRuns);
  std::vector<std::vector<double>> ms(3);
  std::vector<double> rms(3), error(3);
  std::vector<int> iterations(3);
  std::vector<test::BundleScene> starts(3, start);
  test::observe_rays(&starts[1], AngularWeight::kNone);
  test::observe_rays(&starts[2], AngularWeight::kPixel);
  BundleAdjuster adjuster;
  for (int i = 0; i < kRuns; ++i) {
    for (int k = 0; k < 3; ++k) {
      test::BundleScene scene = starts[k];
      const Clock::time_point begin = Clock::now();
      const BundleSummary summary = adjuster.adjust(scene.problem(), {.max_iterations = 20});
      ms[k].push_back(milliseconds_since(begin));
      if (i > 0) continue;
      iterations[k] = summary.iterations;
      for (size_t j = 0; j < scene.poses.size(); ++j) {
        error[k] = std::max(
            error[k],
            (scene.poses[j].inverse().translation - scene.true_poses[j].inverse().translation).norm());
      }
      scene.rays.clear();
      double sum = 0;
      for (size_t o = 0; o < scene.observations.size(); ++o) {
        Eigen::Vector2d r;
        if (residual_of(scene.problem(), static_cast<int>(o), &r)) sum += r.squaredNorm();
      }
      rms[k] = std::sqrt(sum / scene.observations.size());
    }
  }
  const char* names[] = {"pixel", "angular, plain", "angular, whitened"};
  for (int k = 0; k < 3; ++k) {
    std::printf("  %-18s %2d iterations  %.4f ms  %.4f ms an iteration  rms %.5f px  largest error %.5f\n",
                names[k], iterations[k], median(ms[k]), median(ms[k]) / iterations[k], rms[k], error[k]);
  }
}

}  // namespace
}  // namespace raysfm

int main() {
  using raysfm::run;
  raysfm::run_window();
  raysfm::run_errors("errors, pinhole", {});
  raysfm::Camera distorted = raysfm::test::pinhole_camera();
  distorted.model = raysfm::Radtan{500, 510, 320, 240, -0.2, 0.05, 1e-3, -5e-4, 0};
  raysfm::run_errors("errors, radtan", {.cameras = {distorted}});
  run({"local window", {}, false, 301});
  run({"start of a sequence", {.poses = 20, .free_poses = 20, .points = 1500}, false, 51});
  run({"global", {.poses = 200, .free_poses = 200, .points = 20000}, true, 7});
  run({"global, long tracks", {.poses = 200, .free_poses = 200, .points = 5000, .track = 20}, true, 7});
}
