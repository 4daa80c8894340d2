// Processor time and accuracy of the robust estimators on synthetic scenes: pose of a frame from 800 points,
// start from three views of 400 matches. Usage: robust_benchmark [trials, default 200]

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/robust/absolute_pose.h"
#include "raysfm/robust/three_view_start.h"

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using namespace raysfm;

// Milliseconds of this (single-threaded) process.
double processor_ms() {
  return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

Vector3d normal_vector(Rng& rng) {
  return {rng.normal(), rng.normal(), rng.normal()};
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(q * (values.size() - 1))];
}

Rig make_rig(const CameraModel& model) {
  Camera camera;
  camera.model = model;
  camera.width = 1226, camera.height = 370;
  return {{camera}};
}

// 800 points, half a pixel of noise; the prior is off by `prior_px` pixels or missing (negative).
void benchmark_pose(const char* name, const Rig& rig, double outliers, double prior_px, int trials) {
  constexpr int kPoints = 800;
  PoseEstimator estimator;
  PoseEstimate estimate;
  std::vector<double> times, errors;
  int failures = 0;
  for (int trial = 0; trial < trials; ++trial) {
    Rng rng(trial, 1);
    const Rigid3 truth{exp_so3(normal_vector(rng)), 10 * normal_vector(rng)};
    const Rigid3 inverse = truth.inverse();
    std::vector<Vector3d> points;
    std::vector<Vector2d> pixels;
    for (int i = 0; i < kPoints; ++i) {
      Vector2d pixel(rng.uniform(0, 1225), rng.uniform(0, 369));
      Ray ray;
      if (!rig.cameras[0].ray(pixel, &ray)) continue;
      points.push_back(inverse * Vector3d(rng.uniform(5, 50) * ray.direction));
      if (i < outliers * kPoints) pixel = {rng.uniform(0, 1225), rng.uniform(0, 369)};
      pixels.push_back(pixel + 0.5 * Vector2d(rng.normal(), rng.normal()));
    }
    const Rigid3 prior{exp_so3(prior_px / 700 * normal_vector(rng).normalized()) * truth.rotation,
                       truth.translation};
    PoseOptions options;
    options.seed = trial;
    const double start = processor_ms();
    estimator.estimate(rig, {points, pixels, {}}, prior_px >= 0 ? &prior : nullptr, options, &estimate);
    times.push_back(processor_ms() - start);
    failures += !estimate.ok();
    errors.push_back((estimate.rig_from_world.inverse().translation - inverse.translation).norm());
  }
  std::printf("%-44s %9.3f %9.3f %12.4f %9d\n", name, quantile(times, 0.5), quantile(times, 0.95),
              quantile(errors, 0.5), failures);
}

// 400 matches, half a pixel of noise at f = 700.
void benchmark_start(const char* name, const Vector3d& step, double outliers, int trials) {
  constexpr int kMatches = 400;
  constexpr double kPixel = 1.0 / 700;
  std::vector<double> times, errors;
  int failures = 0;
  for (int trial = 0; trial < trials; ++trial) {
    Rng rng(trial, 2);
    const Vector3d axis = normal_vector(rng).normalized();
    std::array<std::vector<Vector3d>, 3> bearings;
    Rigid3 pose;
    std::vector<Vector3d> points;
    for (int i = 0; i < kMatches; ++i) {
      points.push_back(rng.uniform(5, 40) * Vector3d(rng.uniform(-0.8, 0.8), rng.uniform(-0.25, 0.25), 1));
    }
    for (int v = 0; v < 3; ++v) {
      pose = Rigid3{exp_so3(0.02 * v * axis), v * step}.inverse();
      for (int i = 0; i < kMatches; ++i) {
        const bool outlier = v > 0 && i < outliers * kMatches;
        const Vector3d b =
            (pose * points[i]).normalized() + (outlier ? 0.1 : 0.5 * kPixel) * normal_vector(rng);
        bearings[v].push_back(b.normalized());
      }
    }
    ThreeViewOptions options;
    options.max_error = 1.5 * kPixel;
    options.seed = trial;
    const double start_time = processor_ms();
    const ThreeViewStart start = start_from_three_views(bearings[0], bearings[1], bearings[2], options);
    times.push_back(processor_ms() - start_time);
    failures += !start.ok();
    errors.push_back((start.cam2_from_cam0.translation - pose.translation.normalized()).norm());
  }
  std::printf("%-44s %9.3f %9.3f %12.4f %9d\n", name, quantile(times, 0.5), quantile(times, 0.95),
              quantile(errors, 0.5), failures);
}

}  // namespace

int main(int argc, char** argv) {
  const int trials = argc > 1 ? std::max(1, std::atoi(argv[1])) : 200;
  std::printf("%-44s %9s %9s %12s %9s\n", "", "median ms", "95 % ms", "error", "failures");
  const Rig pinhole = make_rig(Pinhole{707, 707, 602, 183});
  const Rig radtan = make_rig(Radtan{707, 707, 602, 183, -0.1, 0.02, 1e-3, 1e-3});
  benchmark_pose("pose, pinhole, prior off by 1 px, 10 % wrong", pinhole, 0.1, 1, trials);
  benchmark_pose("pose, radtan, prior off by 1 px, 10 % wrong", radtan, 0.1, 1, trials);
  benchmark_pose("pose, pinhole, prior off by 20 px, 30 % wrong", pinhole, 0.3, 20, trials);
  benchmark_pose("pose, pinhole, no prior, all right", pinhole, 0, -1, trials);
  benchmark_pose("pose, pinhole, no prior, 30 % wrong", pinhole, 0.3, -1, trials);
  benchmark_pose("pose, radtan, no prior, 50 % wrong", radtan, 0.5, -1, trials);
  benchmark_pose("pose, pinhole, no prior, 70 % wrong", pinhole, 0.7, -1, trials);
  benchmark_start("start, sideways, all right", {0.4, 0, 0}, 0, trials);
  benchmark_start("start, sideways, 40 % wrong", {0.4, 0, 0}, 0.4, trials);
  benchmark_start("start, forward, all right", {0, 0, 1}, 0, trials);
  benchmark_start("start, forward, 40 % wrong", {0, 0, 1}, 0.4, trials);
}
