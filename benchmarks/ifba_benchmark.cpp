// The experiments of IFBA01 (Malis, Bartoli 2001), figures 2 to 13: standard, intrinsics-free and polished
// adjustment from the same start with the same stopping rule. Prints tables (Markdown); --plots writes
// charts. Usage: ifba_benchmark [--trials N, default 1000] [--figure N, 1 to 13, default all] [--plots DIR]
// [--seed N]
// A number chooses the run that draws it: 1 (weights of the constraints, no figure of the paper); 2, 3, 4; 5
// (also 6, 7); 8 (also 9, 10); 11; 12 (also 13).

#include <time.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "line_chart.h"
#include "raysfm/lenses/next_instant.h"
#include "raysfm/lenses/triangular_factor.h"
#include "raysfm/uncalibrated/reconstruct.h"
#include "support/test_scenes.h"

namespace {

using raysfm::LensAdjustmentOptions;
using raysfm::LensAdjustmentSummary;
using raysfm::PointTracks;
using raysfm::Rng;
using raysfm::UncalibratedScene;
using raysfm::test_scenes::add_noise;
using raysfm::test_scenes::Cube;
using raysfm::test_scenes::make_cube;
using raysfm::test_scenes::project_all;

struct Settings {
  int trials = 1000;
  int figure = 0;
  uint64_t seed = 1;
  std::string plots;
};

enum Method { kStandard, kFree, kLeastSquares, kPolished, kMethods };
constexpr const char* kNames[] = {"standard", "free, moments", "free, least squares", "polished"};

double cpu_ms() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * double(t.tv_sec) + 1e-6 * double(t.tv_nsec);
}

double median(std::vector<double> values) {
  if (values.empty()) return NAN;
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// What is measured of one method over the trials.
struct Samples {
  std::vector<double> ms, iterations, structure, focal, to_own, to_common;  // structure: mm, focal: %
  int unreached = 0;
};

double focal_error(const UncalibratedScene& scene, const UncalibratedScene& truth) {
  double sum = 0;
  for (size_t j = 0; j < truth.lenses.size(); ++j)
    sum += std::abs(scene.lenses[j].fx / truth.lenses[j].fx - 1);
  return sum / double(truth.lenses.size());
}

int first_within(const std::vector<double>& costs, double limit) {
  for (size_t i = 0; i < costs.size(); ++i) {
    if (costs[i] <= limit) return static_cast<int>(i);
  }
  return -1;
}

LensAdjustmentOptions options_of(bool equal, Method method) {
  LensAdjustmentOptions options;
  options.constraints = {.zero_skew = true, .unit_aspect = true, .equal = equal};
  if (equal) options.constraints.zero_skew = options.constraints.unit_aspect = false;
  if (method == kLeastSquares) options.estimate = raysfm::LensEstimate::kLeastSquares;
  options.with_sigma = false;
  return options;
}

raysfm::Result<LensAdjustmentSummary> run(Method method, const PointTracks& tracks,
                                          const LensAdjustmentOptions& options, UncalibratedScene* scene) {
  if (method == kStandard) return adjust_standard(tracks, {}, options, scene);
  if (method == kPolished) return adjust_polished(tracks, {}, options, scene);
  return adjust_intrinsics_free(tracks, {}, options, scene);
}

// All methods from one start. False, and nothing is counted, when one of them cannot use it.
bool compare(const Cube& cube, const UncalibratedScene& start, bool equal, std::vector<Samples>* samples) {
  UncalibratedScene scenes[kMethods];
  LensAdjustmentSummary summaries[kMethods];
  double ms[kMethods], common = INFINITY;
  for (int m = 0; m < kMethods; ++m) {
    scenes[m] = start;
    const double began = cpu_ms();
    auto summary = run(Method(m), cube.tracks, options_of(equal, Method(m)), &scenes[m]);
    ms[m] = cpu_ms() - began;
    if (!summary || summary->dropped > 0) return false;
    summaries[m] = std::move(*summary);
    if (m != kFree) common = std::min(common, summaries[m].lm.final_cost);
  }
  for (int m = 0; m < kMethods; ++m) {
    Samples& s = (*samples)[m];
    s.ms.push_back(ms[m]);
    s.iterations.push_back(summaries[m].lm.iterations);
    s.structure.push_back(1e3 * raysfm::test_scenes::structure_error(scenes[m].points, cube.truth.points));
    s.focal.push_back(100 * focal_error(scenes[m], cube.truth));
    const int before = summaries[m].lm.iterations - static_cast<int>(summaries[m].costs.size()) + 1;
    s.to_own.push_back(before + first_within(summaries[m].costs, 1.01 * summaries[m].lm.final_cost));
    const int reached = first_within(summaries[m].costs, 1.01 * common);
    if (reached >= 0) s.to_common.push_back(before + reached);
    s.unreached += reached < 0;
  }
  return true;
}

struct Row {
  double x;
  std::vector<Samples> samples;
  int failed;
};

void print_header(const char* x) {
  std::printf(
      "| %s | method | CPU ms | iterations | to 1 %% of own | to 1 %% of common (share of trials) | "
      "structure "
      "error, mm | focal error, %% | trials |\n|---|---|---|---|---|---|---|---|---|\n",
      x);
}

void print(const Row& row) {
  for (int m = 0; m < kMethods; ++m) {
    const Samples& s = row.samples[m];
    const double trials = double(s.ms.size());
    std::printf("| %g | %s | %.2f | %.0f | %.0f | %.0f (%.0f %%) | %.3g | %.3g | %zu |\n", row.x, kNames[m],
                median(s.ms), median(s.iterations), median(s.to_own), median(s.to_common),
                100 * (trials - s.unreached) / trials, median(s.structure), median(s.focal), s.ms.size());
  }
  std::fflush(stdout);
}

LineChart chart(const std::vector<Row>& rows, const char* x, const char* y,
                std::vector<double> Samples::*field) {
  LineChart chart{x, y, {}, {}};
  for (const Row& row : rows) chart.x.push_back(row.x);
  for (int m = 0; m < kMethods; ++m) {
    chart.series.push_back({kNames[m], {}});
    for (const Row& row : rows) chart.series.back().y.push_back(median(row.samples[m].*field));
  }
  return chart;
}

void draw(const Settings& settings, const std::vector<Row>& rows, const char* x, const std::string& name) {
  if (settings.plots.empty()) return;
  draw_charts({chart(rows, x, "CPU ms", &Samples::ms), chart(rows, x, "iterations", &Samples::iterations),
               chart(rows, x, "structure error, mm", &Samples::structure),
               chart(rows, x, "focal error, %", &Samples::focal)},
              settings.plots + "/" + name);
}

struct Condition {
  raysfm::test_scenes::CubeOptions cube;
  double noise;
};

Row measure(const Settings& settings, double x, const Condition& condition, uint64_t stream) {
  Row row{x, std::vector<Samples>(kMethods), 0};
  for (int t = 0; t < settings.trials; ++t) {
    Rng rng(settings.seed + static_cast<uint64_t>(t), stream);
    Cube cube = make_cube(condition.cube, &rng);
    add_noise(condition.noise, &rng, &cube.tracks);
    const bool equal = !condition.cube.zooming;
    const auto start = linear_start(cube.tracks, {.max_error_px = 1 + 5 * condition.noise}, equal);
    if (!start || !compare(cube, *start, equal, &row.samples)) ++row.failed;
  }
  return row;
}

void figures_5_to_10(const Settings& settings, bool zooming) {
  const char* name = zooming ? "Figures 8 to 10: varying focal length and principal point"
                             : "Figures 5 to 7: fixed intrinsics";
  const int images = 6;
  std::printf("\n### %s, noise, %d images\n\n", name, images);
  print_header("noise px");
  std::vector<Row> rows;
  for (const double noise : {0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0}) {
    rows.push_back(measure(settings, noise, {{.images = images, .zooming = zooming}, noise}, 11));
    print(rows.back());
  }
  const std::string prefix = zooming ? "ifba_zoom" : "ifba_fixed";
  draw(settings, rows, "noise, px", prefix + "_noise.png");
  std::printf("\n### %s, number of images, 1 px of noise\n\n", name);
  print_header("images");
  rows.clear();
  for (int m = zooming ? 4 : 3; m <= 10; ++m) {
    rows.push_back(measure(settings, m, {{.images = m, .zooming = zooming}, 1.0}, 12));
    print(rows.back());
  }
  draw(settings, rows, "images", prefix + "_images.png");
}

void figure_11(const Settings& settings) {
  std::printf("\n### Figure 11: principal point off the centre, 8 images, 1 px of noise\n\n");
  print_header("std px");
  std::vector<Row> rows;
  for (const double spread : {0.0, 10.0, 20.0, 30.0, 40.0, 50.0}) {
    rows.push_back(measure(settings, spread,
                           {{.images = 8, .zooming = true, .principal_point_spread = spread}, 1.0}, 13));
    print(rows.back());
  }
  draw(settings, rows, "principal point, std px", "ifba_principal_point.png");
}

// Figures 2 to 4: relative errors of T_p, and of K = T_p T_m^-1 with the true T_m, mean and deviation.
struct Spread {
  double sum = 0, squares = 0;
  int count = 0;
  void add(double x) { sum += x, squares += x * x, ++count; }
  double mean() const { return sum / count; }
  double deviation() const { return std::sqrt(std::max(0.0, squares / count - mean() * mean())); }
};

void moment_errors(int samples, uint64_t seed, int points, double noise, Spread* q, Spread* k) {
  Rng rng(seed, 21);
  const raysfm::Lens truth{1000, 1000, 250, 250, 0};
  for (int t = 0; t < samples; ++t) {
    raysfm::Moments exact, noisy, plane;
    const auto pose = raysfm::test_scenes::looking_at_origin({0.3, 0.2, 1.0}, 0.5);
    for (int i = 0; i < points; ++i) {
      Eigen::Vector3d x;
      do x = {rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1)};
      while (x.norm() > 0.1);
      const Eigen::Vector2d m = (pose * x).hnormalized(), p = truth.pixel(m);
      plane.add(m, 1);
      exact.add(p, 1);
      noisy.add(p + noise * Eigen::Vector2d(rng.normal(), rng.normal()), 1);
    }
    raysfm::TriangularFactor t_exact, t_noisy, t_m;
    if (!exact.factor(&t_exact) || !noisy.factor(&t_noisy) || !plane.factor(&t_m)) continue;
    q[0].add(t_noisy.a / t_exact.a - 1);
    q[1].add((t_noisy.b - t_exact.b) / t_exact.a);  // q12 may be near 0: as a share of q11
    q[2].add(t_noisy.c / t_exact.c - 1);
    q[3].add(t_noisy.d / t_exact.d - 1);
    q[4].add(t_noisy.e / t_exact.e - 1);
    const raysfm::Lens lens = (t_noisy * t_m.inverse()).lens();
    k[0].add(lens.fx / truth.fx - 1);
    k[1].add(lens.fy / lens.fx - 1);
    k[2].add(lens.skew / lens.fx / (M_PI / 2));  // angle of the axes, small
    k[3].add(lens.cx / truth.cx - 1);
    k[4].add(lens.cy / truth.cy - 1);
  }
}

using Spreads = std::array<Spread, 5>;
constexpr std::array<const char*, 5> kEntriesOfQ = {"q11", "q12", "q13", "q22", "q23"};
constexpr std::array<const char*, 5> kNumbersOfK = {"f", "aspect", "skew angle", "u0", "v0"};

void print_spreads(const char* x_title, const std::array<const char*, 5>& names, const std::vector<double>& x,
                   const std::vector<Spreads>& rows) {
  std::printf("\n| %s |", x_title);
  for (const char* name : names) std::printf(" %s |", name);
  std::printf("\n|---|---|---|---|---|---|\n");
  for (size_t i = 0; i < x.size(); ++i) {
    std::printf("| %g |", x[i]);
    for (const Spread& s : rows[i]) std::printf(" %+.2f ± %.2f |", 100 * s.mean(), 100 * s.deviation());
    std::printf("\n");
  }
}

LineChart spread_chart(const char* x_title, const char* y_title, const std::array<const char*, 5>& names,
                       const std::vector<double>& x, const std::vector<Spreads>& rows,
                       double (Spread::*value)() const) {
  LineChart chart{x_title, y_title, x, {}};
  for (size_t n = 0; n < names.size(); ++n) {
    chart.series.push_back({names[n], {}});
    for (const Spreads& row : rows) chart.series.back().y.push_back(100 * (row[n].*value)());
  }
  return chart;
}

void figures_2_to_4(const Settings& settings) {
  const int samples = 10 * settings.trials;
  const std::vector<double> noises = {0, 0.5, 1, 1.5, 2, 2.5, 3};
  const std::vector<double> numbers = {10, 20, 30, 40, 50, 60, 70, 80, 90, 100};
  std::vector<Spreads> q(noises.size()), k(noises.size()), k_of_number(numbers.size());
  for (size_t i = 0; i < noises.size(); ++i)
    moment_errors(samples, settings.seed, 100, noises[i], q[i].data(), k[i].data());
  for (size_t i = 0; i < numbers.size(); ++i) {
    Spreads unused;
    moment_errors(samples, settings.seed, static_cast<int>(numbers[i]), 1, unused.data(),
                  k_of_number[i].data());
  }
  std::printf("\n### Figures 2 and 3: Q = T_p and K over noise, 100 points, relative errors in %%\n");
  print_spreads("noise px", kEntriesOfQ, noises, q);
  print_spreads("noise px", kNumbersOfK, noises, k);
  std::printf("\n### Figure 4: K over the number of points, 1 px of noise, relative errors in %%\n");
  print_spreads("points", kNumbersOfK, numbers, k_of_number);
  if (settings.plots.empty()) return;
  draw_charts(
      {spread_chart("noise, px", "std of Q, %", kEntriesOfQ, noises, q, &Spread::deviation),
       spread_chart("noise, px", "std of K, %", kNumbersOfK, noises, k, &Spread::deviation),
       spread_chart("noise, px", "mean error of K, %", kNumbersOfK, noises, k, &Spread::mean),
       spread_chart("points", "std of K at 1 px, %", kNumbersOfK, numbers, k_of_number, &Spread::deviation)},
      settings.plots + "/ifba_moments.png");
}

// Figures 12 and 13: eight zooming cameras on an object that turns (share 1 - k) and moves away (share k)
// while they zoom to keep its size and turn to keep it in the middle; adjusted at each instant from the last.
UncalibratedScene at_instant(const Cube& first, const std::vector<Eigen::Vector3d>& shape, double k,
                             int instant) {
  UncalibratedScene scene = first.truth;
  const double turn = (1 - k) * 0.05 * instant, away = k * 0.05 * instant;
  const Eigen::Quaterniond rotation = raysfm::exp_so3({0, turn, 0});
  for (size_t i = 0; i < shape.size(); ++i) scene.points[i] = rotation * shape[i];
  for (size_t j = 0; j < scene.cam_from_world.size(); ++j) {
    raysfm::Rigid3& pose = scene.cam_from_world[j];
    pose.translation.z() += away * 7;
    const double zoom = pose.translation.z() / first.truth.cam_from_world[j].translation.z();
    scene.lenses[j].fx = scene.lenses[j].fy = first.truth.lenses[j].fx * zoom;
    scene.lenses[j].cx += 20 * away * std::cos(double(j));
    scene.lenses[j].cy += 20 * away * std::sin(double(j));
    // The camera turns a little against the object.
    pose.rotation =
        (raysfm::exp_so3({0.3 * turn * std::sin(double(j)), 0, 0.3 * turn * std::cos(double(j))}) *
         pose.rotation)
            .normalized();
  }
  return scene;
}

bool follow(const Settings& settings, uint64_t trial, double k, bool deforming,
            std::vector<Samples>* samples) {
  constexpr int kInstants = 6;
  constexpr double kNoise = 0.5, kDeformation = 0.1;
  Rng rng(settings.seed + trial, 31);
  const Cube first = make_cube({.images = 8, .zooming = true}, &rng);
  std::vector<Eigen::Vector3d> shape = first.truth.points;
  std::vector<UncalibratedScene> estimates(kMethods, first.truth);
  for (int instant = 1; instant <= kInstants; ++instant) {
    if (deforming) {
      for (Eigen::Vector3d& x : shape) {
        x += kDeformation * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
      }
    }
    Cube cube;
    cube.truth = at_instant(first, shape, k, instant);
    project_all(cube.truth, &cube.tracks);
    add_noise(kNoise, &rng, &cube.tracks);
    for (int m = 0; m < kMethods; ++m) {
      const double began = cpu_ms();
      const LensAdjustmentOptions options = options_of(false, Method(m));
      const auto summary = m == kPolished ? adjust_next_instant(cube.tracks, options, &estimates[m])
                                          : run(Method(m), cube.tracks, options, &estimates[m]);
      const double ms = cpu_ms() - began;
      if (!summary || summary->dropped > 0) return false;
      Samples& s = (*samples)[m];
      s.ms.push_back(ms);
      s.iterations.push_back(summary->lm.iterations);
      s.structure.push_back(1e3 *
                            raysfm::test_scenes::structure_error(estimates[m].points, cube.truth.points));
      s.focal.push_back(100 * focal_error(estimates[m], cube.truth));
    }
  }
  return true;
}

void figures_12_and_13(const Settings& settings) {
  for (const bool deforming : {false, true}) {
    std::printf("\n### Figures 12 and 13: %s object followed by 8 zooming cameras, 0.5 px of noise\n\n",
                deforming ? "deforming" : "rigid");
    std::printf(
        "| lens share %% | method | CPU ms | iterations | structure error, mm | focal error, %% | "
        "adjustments |\n"
        "|---|---|---|---|---|---|---|\n");
    std::vector<Row> rows;
    for (const double k : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      Row row{100 * k, std::vector<Samples>(kMethods), 0};
      for (int t = 0; t < settings.trials; ++t) {
        row.failed += !follow(settings, static_cast<uint64_t>(t), k, deforming, &row.samples);
      }
      for (int m = 0; m < kMethods; ++m) {
        const Samples& s = row.samples[m];
        std::printf("| %g | %s | %.2f | %.0f | %.3g | %.3g | %zu |\n", row.x, kNames[m], median(s.ms),
                    median(s.iterations), median(s.structure), median(s.focal), s.ms.size());
      }
      std::fflush(stdout);
      rows.push_back(std::move(row));
    }
    draw(settings, rows, "lens share, %", deforming ? "ifba_deforming.png" : "ifba_rigid.png");
  }
}

// Intrinsics-free by moments, its constraints with the weights that moments can bear and with heavy ones.
void constraint_weights(const Settings& settings) {
  std::printf(
      "\n### Weights of the constraints, 6 images\n\n"
      "| set-up | noise px | weight | iterations | structure error, mm | focal error, %% |\n"
      "|---|---|---|---|---|---|\n");
  for (const bool zooming : {false, true}) {
    for (const double noise : {0.5, 1.0, 3.0}) {
      for (const double weight : {1.0, 100.0}) {
        Samples samples;
        for (int t = 0; t < settings.trials; ++t) {
          Rng rng(settings.seed + static_cast<uint64_t>(t), 41);
          Cube cube = make_cube({.images = 6, .zooming = zooming}, &rng);
          add_noise(noise, &rng, &cube.tracks);
          auto scene = linear_start(cube.tracks, {.max_error_px = 1 + 5 * noise}, !zooming);
          if (!scene) continue;
          LensAdjustmentOptions options = options_of(!zooming, kFree);
          options.constraint_weight = weight;
          const auto summary = adjust_intrinsics_free(cube.tracks, {}, options, &*scene);
          if (!summary) continue;
          samples.iterations.push_back(summary->lm.iterations);
          samples.structure.push_back(1e3 *
                                      raysfm::test_scenes::structure_error(scene->points, cube.truth.points));
          samples.focal.push_back(100 * focal_error(*scene, cube.truth));
        }
        std::printf("| %s | %g | %g | %.0f | %.3g | %.3g |\n", zooming ? "zoom" : "fixed", noise, weight,
                    median(samples.iterations), median(samples.structure), median(samples.focal));
      }
    }
  }
}

bool parse(int argc, char** argv, Settings* settings) {
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string option = argv[i], value = argv[i + 1];
    if (option == "--trials")
      settings->trials = std::atoi(value.c_str());
    else if (option == "--figure")
      settings->figure = std::atoi(value.c_str());
    else if (option == "--seed")
      settings->seed = std::strtoull(value.c_str(), nullptr, 10);
    else if (option == "--plots")
      settings->plots = value;
    else
      return false;
  }
  return argc % 2 == 1 && settings->trials > 0;
}

}  // namespace

int main(int argc, char** argv) {
  Settings settings;
  if (!parse(argc, argv, &settings)) {
    std::fprintf(stderr, "usage: ifba_benchmark [--trials N] [--figure 1..13] [--plots DIR] [--seed N]\n");
    return 2;
  }
  const auto wanted = [&](int first, int last) {
    return settings.figure == 0 || (settings.figure >= first && settings.figure <= last);
  };
  if (wanted(1, 1)) constraint_weights(settings);
  if (wanted(2, 4)) figures_2_to_4(settings);
  if (wanted(5, 7)) figures_5_to_10(settings, false);
  if (wanted(8, 10)) figures_5_to_10(settings, true);
  if (wanted(11, 11)) figure_11(settings);
  if (wanted(12, 13)) figures_12_and_13(settings);
  return 0;
}
